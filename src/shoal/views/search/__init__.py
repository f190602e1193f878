"""Views of searches: figures of routes, timelines and tours, films, and the data of the player
page.
"""
