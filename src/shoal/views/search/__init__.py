"""Searches as people look at them: figures of routes, timelines and tours, films, the data of the player."""
