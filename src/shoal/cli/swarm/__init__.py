"""Commands for swarms: map, cover, maps, drive, line, schedule."""
