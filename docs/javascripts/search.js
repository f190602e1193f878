/* A search for --film finds film: to the search, a hyphen before a word would mean "without this word". */
for (const kind of ["keyup", "focus"])
  document.addEventListener(kind, ({ target }) => {
    if (target.matches?.("[data-md-component=search-query]") && target.value.startsWith("-"))
      target.value = target.value.replace(/^-+/, "")
  }, true)
