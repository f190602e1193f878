"""The commands for searches: shoal search, shoal tour and shoal missions."""
