"""Paper W (two particles with one shared input): reproduction of its figures 4 to 9, 11, 12 and 14
to 16.
"""
