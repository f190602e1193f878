"""The compiled kernels of the search part: plain arrays in, plain arrays out; they never raise."""
