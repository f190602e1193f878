"""Kernels that shorten tours: exchanges of cells, and changes of paths along the border."""
