"""What people look at: figures, films and the HTML player. matplotlib is imported here and in papers only."""
