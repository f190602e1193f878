"""Random samples of particles on a line, and minimum numbers of commands per direction."""
