"""Papers M and D, mapping and coverage with a particle swarm: their figures and theorems, computed and drawn anew."""
