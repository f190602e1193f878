"""Paper H (exhaustive search along a space-filling curve): reproduction of its figure 5, its
baseline methods and curves.
"""
