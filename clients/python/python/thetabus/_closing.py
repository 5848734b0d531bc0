"""What every port on the bus has in common."""

from __future__ import annotations

from types import TracebackType
from typing import Optional, TypeVar

S = TypeVar("S", bound="Closing")


class Closing:
    """Leaves the bus at the end of a `with` block."""

    def close(self) -> None:
        """Leaves; a second time does nothing."""
        raise NotImplementedError

    def __enter__(self: S) -> S:
        return self

    def __exit__(
        self,
        kind: Optional[type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()
