"""What walls do to particles: the worlds, what friction cannot do, noise, and how particles leave walls."""
