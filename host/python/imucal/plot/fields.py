# SPDX-License-Identifier: MIT
"""The fields of a result that a figure takes, checked before it is drawn: a DataError names file and field."""
import json

from ..errors import DataError

_LONGEST = 40  # of what is shown of a field


def _is_number(value):
    """An int or float of JSON; true and false are none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


class Fields:
    """An object of a result and its place in the file."""

    def __init__(self, file, value, place=""):
        self._file, self._value, self._place = file, value, place
        if not isinstance(value, dict):
            raise DataError(f"{file}: {place}: expected an object, found {self._shown(value)}")

    def __contains__(self, name):
        return self._value.get(name) is not None

    def text(self, name, choices=None):
        """A text, or one of the choices."""
        if not isinstance(self._value.get(name), str) or choices and self._value[name] not in choices:
            self._refuse(name, f"one of {', '.join(choices)}" if choices else "a text")

    def number(self, name):
        """A number, which is returned."""
        if not _is_number(self._value.get(name)):
            self._refuse(name, "a number")
        return self._value[name]

    def whole(self, name, default):
        """A whole number above 0, where there is one."""
        value = self._value.get(name, default)
        if not _is_number(value) or not isinstance(value, int) or value < 1:
            self._refuse(name, "a whole number above 0")

    def numbers(self, name, length=None, gaps=False):
        """A list of numbers, of this length; gaps: null stands for a missing one.  Returns the length."""
        values = self._value.get(name)
        if not isinstance(values, list) or not values or not all(_is_number(v) or gaps and v is None for v in values):
            self._refuse(name, "a list of numbers")
        if length and len(values) != length:
            self._refuse(name, f"{length} numbers")
        return len(values)

    def pairs(self, name, length):
        """A list of pairs of numbers; null stands for a missing pair or number."""
        values = self._value.get(name)
        is_one = [v is None or isinstance(v, list) and len(v) == 2 and all(x is None or _is_number(x) for x in v)
                  for v in (values if isinstance(values, list) else ())]
        if len(is_one) != length or not all(is_one):
            self._refuse(name, f"{length} pairs of numbers")

    def inner(self, name):
        """The object that stands there."""
        return Fields(self._file, self._value.get(name), self._at(name))

    def objects(self, name):
        """The objects of a list."""
        values = self._value.get(name)
        if not isinstance(values, list) or not values:
            self._refuse(name, "a list of objects")
        return [Fields(self._file, value, self._at(f"{name}[{i}]")) for i, value in enumerate(values)]

    def _at(self, name):
        return f"{self._place}.{name}" if self._place else name

    @staticmethod
    def _shown(value):
        text = json.dumps(value, ensure_ascii=False)
        return text if len(text) <= _LONGEST else text[:_LONGEST] + " …"

    def _refuse(self, name, expected):
        found = self._shown(self._value[name]) if name in self._value else "nothing"
        raise DataError(f"{self._file}: {self._at(name)}: expected {expected}, found {found}; is it as the program wrote it?")
