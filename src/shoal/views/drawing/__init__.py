"""What all parts draw with: a canvas for frames, the looks of charts, curves with their bands, and the encoding of films."""
