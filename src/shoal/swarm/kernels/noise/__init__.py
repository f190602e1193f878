"""Particles that slip and are seen wrongly, the belief that is made of it, and whole episodes of both."""
