"""Pictures as video stores them: brightness of each pixel, and two differences of colour of each
square of two by two pixels.
"""

from __future__ import annotations

import numpy as np

from shoal.jit.entry import in_place_kernel

WORD = 8  # bytes that are compared at once


@in_place_kernel
def convert_changes(picture, words, last, luma, blue, red):
    """Convert the pixels of a picture that differ from the last picture.

    Parameters
    ----------
    picture : ndarray of uint8, shape (height, width, 3)
    words : ndarray of uint64, shape (n,)
        The bytes of the picture, without the last few.
    last : ndarray of uint64, shape (n,)
        The words of the last picture, which become those of this one.
    luma : ndarray of uint8, shape (height, width)
    blue, red : ndarray of uint8, shape (height / 2, width / 2)
    """
    height, width = luma.shape
    for row in range(0, height, 2):
        left, right = width, 0  # the columns that changed, in either of two rows
        for k in (row, row + 1):
            begin = 3 * width * k
            first = begin // WORD
            end = min((begin + 3 * width + WORD - 1) // WORD, len(words))
            behind = end
            while first < end and words[first] == last[first]:
                first += 1
            while behind > first and words[behind - 1] == last[behind - 1]:
                behind -= 1
            if first < behind:
                left = min(left, max(0, WORD * first - begin) // 3)
                right = max(right, min(width, (WORD * behind - begin + 2) // 3))
        if row + 2 == height and len(words) * WORD < 3 * width * height:
            left, right = min(left, width - WORD), width  # these bytes are in no word
        left = max(0, left // 2 * 2)
        right = (right + 1) // 2 * 2
        # BT.709: Y = 0.2126 R + 0.7152 G + 0.0722 B, (B - Y) / 1.8556 and (R - Y) / 1.5748, scaled
        # to 219 and 224 steps, in units of 2^-16 or, for the mean of four pixels, of 2^-18
        for k in (row, row + 1):
            for col in range(left, right):
                r, g, b = (
                    np.int32(picture[k, col, 0]),
                    np.int32(picture[k, col, 1]),
                    np.int32(picture[k, col, 2]),
                )
                luma[k, col] = (11966 * r + 40254 * g + 4064 * b + (16 << 16) + (1 << 15)) >> 16
        for half in range(left // 2, right // 2):
            r, g, b = np.int32(0), np.int32(0), np.int32(0)
            for k in (row, row + 1):
                for col in (2 * half, 2 * half + 1):
                    r += picture[k, col, 0]
                    g += picture[k, col, 1]
                    b += picture[k, col, 2]
            middle = (128 << 18) + (1 << 17)
            blue[row // 2, half] = (-6596 * r - 22189 * g + 28785 * b + middle) >> 18
            red[row // 2, half] = (28784 * r - 26145 * g - 2639 * b + middle) >> 18
    for k in range(len(words)):
        last[k] = words[k]
