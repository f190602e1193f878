"""Commands for searches: search, tour, missions."""
