"""One record in shared memory, from one writer process to one reader process, with a receipt.

A sequence lock: the counter is odd while the writer writes, and a reader that sees it change reads again. The
order of stores that this needs holds on x86-64; elsewhere it is not shown. Both processes are to be started
by ``multiprocessing`` from one that outlives them: Python removes the memory when that one ends.
"""

from __future__ import annotations

from multiprocessing import shared_memory

import numpy as np

from robots.errors import SetupError
from robots.motion import Block

_TRIES = 100
_ALIGNED = 64


class Mailbox:
    """A record of a given type under a name.

    Parameters
    ----------
    name:
        Name of the shared memory.
    dtype:
        Type of the record, the same on both sides.
    create:
        Make it; whoever makes it also calls :meth:`unlink` in the end.

    Raises
    ------
    SetupError
        There is no memory of that name, or it is too small, or there is one already.
    """

    def __init__(self, name: str, dtype: np.dtype[np.void], *, create: bool) -> None:
        size = _ALIGNED + dtype.itemsize
        try:
            self._memory = shared_memory.SharedMemory(name, create=create, size=size)
        except (FileNotFoundError, FileExistsError) as error:
            raise SetupError(f"shared memory {name}: {error.strerror}") from error
        if self._memory.size < size:
            raise SetupError(f"shared memory {name} has {self._memory.size} bytes, should be {size}")
        self._counters = np.ndarray(2, dtype=np.int64, buffer=self._memory.buf)
        self._record: Block = np.ndarray(1, dtype=dtype, buffer=self._memory.buf, offset=_ALIGNED)
        if create:
            self._counters[:] = 0

    def put(self, record: Block) -> None:
        """Write a record over the last one."""
        self._counters[0] += 1
        np.copyto(self._record, record)
        self._counters[0] += 1

    def get(self, out: Block) -> bool:
        """Read the last record; ``False``: there is none, or the writer stopped within one."""
        for _ in range(_TRIES):
            before = int(self._counters[0])
            if before == 0:
                return False
            if before % 2 == 0:
                np.copyto(out, self._record)
                if int(self._counters[0]) == before:
                    return True
        return False

    def sign(self, number: int) -> None:
        """Reader: say that the record with this number was accepted."""
        self._counters[1] = number

    @property
    def signed(self) -> int:
        """Return the number that the reader signed last."""
        return int(self._counters[1])

    def close(self) -> None:
        """Give the memory back; the mailbox cannot be used any more."""
        del self._counters, self._record
        self._memory.close()

    def unlink(self) -> None:
        """Remove the name."""
        self._memory.unlink()
