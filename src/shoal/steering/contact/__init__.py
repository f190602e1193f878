"""Contact between particles and walls: simulated worlds, limits due to friction, estimates of the
gain, and moves off walls.
"""
