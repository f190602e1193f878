"""The compiled kernels of the steering part: plain arrays in, plain arrays out; they never raise."""
