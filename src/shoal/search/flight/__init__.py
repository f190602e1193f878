"""Vehicles and their motion: properties, travel times, turns and terrain following."""
