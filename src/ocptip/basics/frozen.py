"""Records that nobody changes, and objects that are pickled and varied by the arguments they were made of."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from inspect import signature
from typing import Any, Self
from uuid import UUID, uuid4
from weakref import WeakValueDictionary

import numpy as np


def read_only(array: np.ndarray) -> np.ndarray:
    """Return the array, which nobody can change any more."""
    array.flags.writeable = False
    return array


def settle(record: object, **values: Any) -> None:
    """Set fields of a frozen data class; arrays become read-only."""
    for name, value in values.items():
        object.__setattr__(record, name, read_only(value) if isinstance(value, np.ndarray) else value)


class MadeOf:
    """Base of classes whose objects hold what cannot be pickled, such as CasADi's functions."""

    _arguments: dict[str, Any]
    _known_as: UUID | None = None

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """An object that knows its arguments by name."""
        self = super().__new__(cls)
        arguments = signature(cls.__init__).bind(self, *args, **kwargs).arguments
        self._arguments = dict(list(arguments.items())[1:])
        return self

    def varied(self, **arguments: Any) -> Self:
        """An object made of the same arguments but for the given ones."""
        return type(self)(**{**self._arguments, **arguments})

    def argument(self, name: str) -> Any:
        """The argument of that name it was made of; None if it was left out."""
        return self._arguments.get(name)

    def __reduce__(self) -> tuple:
        """The call that gives this object in its process, in others an equal one, for pickle."""
        self._known_as = self._known_as or uuid4()
        _alive[self._known_as] = self
        return _made, (self._known_as, partial(type(self), **self._arguments))


_alive = WeakValueDictionary[UUID, MadeOf]()


def _made(known_as: UUID, make: Callable[[], MadeOf]) -> MadeOf:
    """The object that this process has by this name, with what it has built since, or a new one."""
    if (made := _alive.get(known_as)) is None:
        made = _alive[known_as] = make()
        made._known_as = known_as
    return made
