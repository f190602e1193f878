"""Commands of the search: search, tour, missions."""
