"""The grid world of the swarm: boards (sets of cells), commands, moves, beliefs, tasks, placements
and scans.
"""
