"""Contact between particles and walls: worlds, limits due to friction, noise, and release from walls."""
