"""Contact between particles and walls: simulated worlds, limits due to friction, disturbances of
plans, and moves off walls.
"""
