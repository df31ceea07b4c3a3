"""Fields of scanners: a switch that says whether anybody is in a field (``std_msgs/Bool``).

The field itself is a monitored region of the cell. While it is free, everybody is outside: a complete report
that lists nobody. While it is not, nothing is said, and unobserved space closes in since it was free last.
"""

from __future__ import annotations

from robots.assumption import Assumption, Certainty
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.people_report import NANO, WORLD, PeopleReport
from verifier.recordings.people_sources.source import Reports, SourceOptions, field_of


class FieldSwitch:
    """Reads ``std_msgs/Bool``, which has no stamp: how old a state may be is the user's to say."""

    schemas = ("std_msgs/msg/Bool",)

    def __init__(self, options: SourceOptions) -> None:
        self._field = options.field

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """List what the switch was taken to say."""
        if self._field is None:
            return ()
        meaning = "stated by the user: with this value nobody is in any monitored region of the cell"
        age = "stated by the user: a state is no older than this when its message arrives"
        return (
            Assumption("recording.switch_free", str(self._field.free_when), "", meaning, Certainty.DECLARED),
            Assumption("recording.switch_age", self._field.age_s, "s", age, Certainty.DECLARED),
        )

    def read(self, message: Decoded) -> Reports:
        """Return a complete report that lists nobody while the field is free, else none."""
        if self._field is None:
            raise SourceError(
                f"{message.topic} has true or false; state which of them says that nobody is in the "
                "monitored regions, and how old it may be, by free_when, age_s and regions in "
                "[recording.switch] of the cell"
            )
        if bool(field_of(message.value, "data")) != self._field.free_when:
            return ()
        seen_ns = message.log_time_ns - round(self._field.age_s * NANO)
        return (PeopleReport(seen_ns, message.log_time_ns, WORLD, True, ()),)

    def finish(self) -> Reports:
        """Nothing is left to say."""
        return ()
