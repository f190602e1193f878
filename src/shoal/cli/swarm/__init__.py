"""The commands for swarms: shoal map, cover, maps, drive, line and schedule."""
