"""Prediction of unknown cells, and of the effect of commands there."""
