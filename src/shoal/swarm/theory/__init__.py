"""Theory from paper M and its extensions: exact formulas in one dimension, scan schedules, and
bounds on the number of moves.
"""
