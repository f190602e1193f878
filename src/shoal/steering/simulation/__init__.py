"""Simulation of steering: the apparatus that planners in a closed loop work with, and inputs played again."""
