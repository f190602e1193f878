"""Planning policies. A planning policy simulates plans in a predicted world before it sends a
command.
"""
