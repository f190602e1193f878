"""What one command does: words of cells, moves, and the cells that they classify."""
