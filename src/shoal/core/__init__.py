"""Code that all parts of Shoal use: problems, episodes, checks of input, errors, files, registries, interruptions by the user."""
