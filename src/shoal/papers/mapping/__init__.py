"""Papers M and D (mapping and coverage with a particle swarm): reproduction of their figures and
theorems.
"""
