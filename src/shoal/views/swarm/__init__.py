"""Views of swarm episodes: figures of maps and frontiers, films, the data of the player page, and
charts of the theory.
"""
