"""Commands of the swarm: map, cover, maps, drive, line, schedule."""
