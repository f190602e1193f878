"""Vehicles in their own units: what they are, how long their ways take, and how they follow turns and terrain."""
