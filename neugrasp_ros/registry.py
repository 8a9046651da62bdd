# SPDX-License-Identifier: Apache-2.0
"""Parts that a configuration chooses by name."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from neugrasp_ros.errors import UnknownNameError

Builder = TypeVar("Builder", bound=Callable[..., Any])


class Registry(Generic[Builder]):
    """A named table of builders.

    Args:
        kind: What the table holds, for messages, such as ``encoder``.
    """

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._builders: dict[str, Builder] = {}

    def register(self, name: str) -> Callable[[Builder], Builder]:
        """Return a decorator that files a class or function under ``name``."""

        def file(builder: Builder) -> Builder:
            self._builders[name] = builder
            return builder

        return file

    def __getitem__(self, name: str) -> Builder:
        """Return the builder called ``name``.

        Raises:
            UnknownNameError: If there is none; the known names are listed.
        """
        if name not in self._builders:
            raise UnknownNameError(self._kind, name, self._builders)
        return self._builders[name]
