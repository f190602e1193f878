"""Rows of results as the store has them: JSON lists, joined by commas, as in ``["done",3],["done",4]``.

JSON parses all values of a row. These kernels take out the columns that are asked for, which is several
times as fast; what they do not understand, they leave to JSON.
"""

from __future__ import annotations

from shoal.jit.entry import in_place_kernel

_COMMA, _OPEN, _CLOSE, _QUOTE = ord(","), ord("["), ord("]"), ord('"')
_BACKSLASH, _BRACE, _MINUS, _ZERO = ord("\\"), ord("{"), ord("-"), ord("0")
DIGITS = 15
"""Digits of a whole number that fits into 64 bits and into a float."""


@in_place_kernel
def find_values(text, width, columns, begins, ends):
    """Find the values of some columns in the text of rows. Return whether all rows are plain.

    A row is plain if it has ``width`` values, and no value is empty or contains a comma, a bracket, a
    brace or an escape. The values of plain rows are not checked otherwise.

    Parameters
    ----------
    text : ndarray of uint8, shape (n,)
    width : int
    columns : ndarray of int64, shape (k,)
        Numbers of the columns, ascending.
    begins, ends : ndarray of int64, shape (k, rows)
        Get the places of the first byte of each value, and of the byte behind it.
    """
    place, length = 0, len(text)
    if length == 0 or text[length - 1] != _CLOSE:  # where every search for the end of a value ends
        return False
    for row in range(begins.shape[1]):
        if row > 0:
            if place >= length or text[place] != _COMMA:
                return False
            place += 1
        if place >= length or text[place] != _OPEN:
            return False
        place += 1  # not the last byte, which is a bracket that closes
        wanted = 0
        for column in range(width):
            begin, quotes = place, 0
            while text[place] != _COMMA and text[place] != _CLOSE:
                byte = text[place]
                if byte == _QUOTE:
                    quotes += 1
                elif byte in (_OPEN, _BACKSLASH, _BRACE):
                    return False
                place += 1
            if place == begin:
                return False
            quoted = place - begin > 1 and text[begin] == _QUOTE and text[place - 1] == _QUOTE
            if quotes != 2 * quoted:
                return False
            if text[place] != (_CLOSE if column == width - 1 else _COMMA):
                return False
            if wanted < len(columns) and columns[wanted] == column:
                begins[wanted, row], ends[wanted, row] = begin, place
                wanted += 1
            place += 1
    return place == length


@in_place_kernel
def read_whole_numbers(text, begins, ends, numbers):
    """Read values as whole numbers of at most `DIGITS` digits. Return whether all of them are some."""
    for k in range(len(begins)):
        place, end = begins[k], ends[k]
        negative = text[place] == _MINUS
        place += negative
        count = end - place
        if count == 0 or count > DIGITS or (text[place] == _ZERO and (count > 1 or negative)):
            return False
        number = 0
        while place < end:
            digit = int(text[place]) - _ZERO
            if digit < 0 or digit > 9:
                return False
            number = 10 * number + digit
            place += 1
        numbers[k] = -number if negative else number
    return True


@in_place_kernel
def mark_equal(text, begins, ends, word, equal):
    """Mark the values whose bytes are those of ``word``; the other marks stay."""
    for k in range(len(begins)):
        if ends[k] - begins[k] == len(word):
            place = 0
            while place < len(word) and text[begins[k] + place] == word[place]:
                place += 1
            equal[k] |= place == len(word)


@in_place_kernel
def join_values(text, begins, ends, joined):
    """Copy values, with a comma behind each. Return the number of bytes."""
    count = 0
    for k in range(len(begins)):
        for place in range(begins[k], ends[k]):
            joined[count] = text[place]
            count += 1
        joined[count] = _COMMA
        count += 1
    return count
