"""Views of steering episodes: figures of plans and of reachable sets, films, and the data of the
player page.
"""
