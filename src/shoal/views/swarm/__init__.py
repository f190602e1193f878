"""Swarm episodes as people look at them: figures of maps and frontiers, films, the data of the player, and charts of the theory."""
