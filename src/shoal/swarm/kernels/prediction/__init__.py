"""What lies in unknown cells, and what a command would bring there."""
