"""Views of swarm episodes: figures of maps and frontiers, films, the data of the player, and charts of the theory."""
