"""Kernels that predict which unknown cells are free, and the effect of commands on the predicted
map.
"""
