"""Drawing tools for all parts: a canvas for film frames, the style of charts, curves with confidence bands, and film encoding."""
