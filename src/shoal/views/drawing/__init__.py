"""Common drawing tools of all parts: a canvas for frames, the style of charts, curves with bands, and film encoding."""
