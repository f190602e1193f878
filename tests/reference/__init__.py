"""Slow, obvious reference implementations that the fast ones are compared with."""
