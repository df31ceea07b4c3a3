"""Where the metres of a witness go: a bar of terms, and the same as a table."""

from __future__ import annotations

from collections.abc import Iterator

from verifier.reports.html.chart import LEFT, RIGHT, WIDTH, Scale, picture
from verifier.reports.html.elements import Node, Numbers, node, table
from verifier.verdict import Witness

TERMS = (
    ("link", "radius of the link's capsule"),
    ("body", "radius of the body part, of the second link or of the fixture"),
    ("latency", "growth between observation and decision"),
    ("stop", "growth between decision and the end of the slice"),
    ("error", "of position, tracking, and the sweep's curvature"),
    ("sides", "left and right may have been exchanged"),
)
"""Key of a term, and what it is, in the order in which they are subtracted."""
_BAR, _ROW = 26.0, 34.0


def budget(numbers: Numbers, key: str, title: str, witness: Witness) -> list[Node]:
    """Return the bar and the table of the budget of a witness, whose key in the result is ``key``."""
    place = (key, "budget_m")
    rows = [("distance", "between the bare axis of the link and the bare points of the other side")]
    rows += [(term, f"− {text}") for term, text in TERMS]
    lines = [(term, text, numbers.show("{:.3f}", *place, term)) for term, text in rows]
    lines += [
        ("gap", "= what is left; negative: an overlap", numbers.show("{:+.3f}", key, "gap_m")),
        ("margin", "what the gap must exceed; not subtracted", numbers.show("{:.4f}", *place, "margin")),
    ]
    listed = table(f"{title}: where the metres go", ("term", "what it is", "m#"), lines)
    terms = numbers.at(*place)
    if None in terms.values() and terms["distance"] is None:
        return [listed]
    return [
        node(
            "figure",
            _bar(terms, witness.gap_m),
            node("figcaption", _caption(witness)),
            class_="chart",
            tabindex="0",
        ),
        listed,
    ]


def _caption(witness: Witness) -> str:
    end = "is left: the gap" if witness.gap_m > 0.0 else "is missing: the overlap"
    return f"The distance above; below it what is taken off, term by term, and what {end}. In metres."


def _bar(terms: dict[str, float], gap: float) -> Node:
    taken = [(term, float(terms[term])) for term, _text in TERMS]
    total = sum(value for _term, value in taken)
    x = Scale(0.0, max(float(terms["distance"]), total, 1e-3), LEFT, WIDTH - RIGHT)
    kind = "gap" if gap > 0.0 else "overlap"
    ends = sorted((total, float(terms["distance"])))
    described = ", ".join(f"{term} {value:.3f} m" for term, value in taken)
    return picture(
        "Where the metres go",
        f"Distance {terms['distance']:.3f} m; taken off: {described}; gap {gap:+.3f} m",
        (WIDTH, 3 * _ROW + 16.0),
        [
            node("text", "distance", x=LEFT - 8.0, y=22.0, text_anchor="end"),
            node("path", d=_bracket(x(0.0), x(float(terms["distance"]))), class_="bracket"),
            node("text", "taken off", x=LEFT - 8.0, y=_ROW + 20.0, text_anchor="end"),
            *_stack(taken, x),
            node("text", kind, x=LEFT - 8.0, y=2 * _ROW + 36.0, text_anchor="end"),
            _box(x(ends[0]), 2 * _ROW + 18.0, max(x(ends[1]) - x(ends[0]), 1.0), f"term-{kind}"),
        ],
    )


def _box(x: float, y: float, width: float, kind: str) -> Node:
    return node("rect", x=x, y=y, width=width, height=_BAR, class_=kind)


def _bracket(a: float, b: float) -> str:
    return f"M{a:.1f} 10V26M{a:.1f} 18H{b:.1f}M{b:.1f} 10V26"


def _stack(taken: list[tuple[str, float]], x: Scale) -> Iterator[Node]:
    """Yield the bars of the terms, each with its name in or below it."""
    at = 0.0
    for term, value in taken:
        left, width = x(at), x(at + value) - x(at)
        at += value
        if value > 0.0:
            bar = _box(left, _ROW + 2.0, width, f"term-{term}")
            bar.append(node("title", f"{term} {value:.3f} m"))
            yield bar
            if width > 9.0 * len(term) * 0.75:
                yield node(
                    "text", term, x=left + width / 2.0, y=_ROW + 44.0, text_anchor="middle", class_="tick"
                )
