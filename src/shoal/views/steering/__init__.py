"""Steering episodes as people look at them: figures of plans and of what moves reach, films, the data of the player."""
