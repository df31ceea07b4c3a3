"""The program: runs the command line and turns whatever happens into an exit status and at most one line.

Exit status: 0 all verified and nothing waived · 1 something not verified or contradicted · 2 input refused,
one line · 3 verified under waivers, which are listed · 70 internal error · 128 + n stopped by signal n.
"""

from __future__ import annotations

import io
import os
import signal
import sys
from contextlib import suppress

from robots.errors import SetupError
from verifier.shown import LONGEST_NOTE, shown

TYPE_CHECKING = False
"""As in ``typing``, which takes as long to import as all that is needed before Ctrl-C is seen to."""
if TYPE_CHECKING:
    from sys import UnraisableHookArgs
    from types import FrameType
    from typing import NoReturn

INPUT_REFUSED = 2
INTERNAL_ERROR = 70
_STOPPING = [number for number in signal.Signals if number.name in ("SIGTERM", "SIGHUP")]


def main() -> NoReturn:
    """Run the command line and exit with its status; bad input never shows a traceback."""
    _repair_streams()
    _leave_in_order_when_stopped()
    lost = _heed_what_callbacks_swallow()
    try:
        from verifier.compiled_cache import choose_folder  # these imports take a second and may fail

        choose_folder()
        from verifier.commands import run

        status = run(sys.argv[1:])
    except (KeyboardInterrupt, SystemExit) as stop:
        number = _signal_of(stop)
        if number is not None:
            _end_by(number)
        _fail(f"internal error: {type(stop).__name__}: {stop}", INTERNAL_ERROR)
    except SetupError as error:
        _fail(str(error), INPUT_REFUSED)
    except OSError as error:
        _fail(_os_error_text(error), INPUT_REFUSED)
    except Exception as error:
        if lost:
            _end_by(lost[0])
        _fail(f"internal error: {type(error).__name__}: {error}", INTERNAL_ERROR)
    _exit(status)


def _end_by(number: signal.Signals) -> NoReturn:
    by = "the user" if number == signal.SIGINT else number.name
    _fail(f"stopped by {by}", 128 + number)


def _fail(text: str, status: int) -> NoReturn:
    with suppress(OSError, ValueError):
        print(f"stopproof: {shown(' '.join(text.split()), LONGEST_NOTE)}", file=sys.stderr)
    _exit(status)


def _exit(status: int) -> NoReturn:
    """Exit; that nobody takes what is left in a stream must not change the status."""
    for stream, number in ((sys.stdout, 1), (sys.stderr, 2)):
        try:
            stream.flush()
        except (OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
    sys.exit(status)


def _os_error_text(error: OSError) -> str:
    """Return file and reason of what the system refused."""
    reason = error.strerror or str(error) or type(error).__name__
    if isinstance(error.filename, str | bytes):
        return f"{os.fsdecode(error.filename)}: {reason}"
    try:
        os.getcwd()  # noqa: PTH109 - pathlib is not imported here
    except OSError:
        return f"the current folder: {reason}; change to one that exists and can be read"
    return reason


def _repair_streams() -> None:
    """Make sure that there are streams, and that no text is refused by them.

    A stream that is closed (``>&-``) would give its number to the next file that is opened, and what
    libraries print would go there.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - stays open to the end
    if sys.stderr is None:
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - stays open to the end
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _leave_in_order_when_stopped() -> None:
    """Let a signal that stops the program run what cleans up: files that are half written go."""
    for number in _STOPPING:
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup has SIGHUP ignored
            with suppress(ValueError):  # only the main thread may
                signal.signal(number, _stop)


def _heed_what_callbacks_swallow() -> list[signal.Signals]:
    """Send a signal again that arrives while a library calls back; return where such signals are noted.

    What is raised within a callback from C, as LLVM makes them while functions are compiled, goes no farther:
    the program would run on, or end in an error of the library's.
    """
    lost: list[signal.Signals] = []
    others = sys.unraisablehook

    def again(what: UnraisableHookArgs) -> None:
        number = _signal_of(what.exc_value)
        if number is None:
            others(what)
            return
        from threading import Timer  # loads what is needed here alone

        lost.append(number)
        timer = Timer(0.02, os.kill, (os.getpid(), number))
        timer.daemon = True
        timer.start()

    sys.unraisablehook = again
    return lost


def _signal_of(error: BaseException | None) -> signal.Signals | None:
    if isinstance(error, KeyboardInterrupt):
        return signal.SIGINT
    code = error.code if isinstance(error, SystemExit) else None
    return next((number for number in _STOPPING if code == 128 + number), None)


def _stop(number: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)


if __name__ == "__main__":
    main()
