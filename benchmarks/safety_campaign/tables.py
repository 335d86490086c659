"""The tables of docs/safety.md, from the results."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path

from safety_campaign.results import upper_bound

Row = dict[str, str]
Cells = Sequence[str]
END = "<!-- end -->"
NAMES = {"sampled": "sampled", "cbf": "(33)", "none": "none"}


def write(path: Path, rows: list[Row], tables: Mapping[str, Callable[[list[Row]], str]]) -> None:
    """Put the tables between the marks of the document."""
    path.write_text(filled(path.read_text(encoding="utf-8"), rows, tables), encoding="utf-8")


def filled(text: str, rows: list[Row], tables: Mapping[str, Callable[[list[Row]], str]]) -> str:
    """The document with the tables of these results between its marks ``<!-- name -->`` … ``<!-- end -->``."""
    for name, make in tables.items():
        before, mark, rest = text.partition(f"<!-- {name} -->\n")
        text = f"{before}{mark}{make(rows)}\n{END}{rest.partition(END)[2]}"
    return text


def markdown(header: Cells, body: Iterable[Cells]) -> str:
    """A table, its first column to the left and the others to the right."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (header, rule, *body))


def total(rows: Iterable[Row], column: str) -> int:
    """Sum of a count."""
    return sum(int(row[column]) for row in rows)


def share(count: int, n: int) -> str:
    """A share in per cent; in place of a zero its exact bound."""
    return f"{100 * count / n:.3g} %" if count else f"0 [≤ {upper_bound(0, n):.1e}]"


def rate(count: int, n: int) -> str:
    """A count, and its share."""
    return f"{count:,} ({share(count, n)})" if count else share(count, n)


def kind(rows: Iterable[Row], *kinds: str, **columns: str) -> list[Row]:
    """The rows of these kinds with these columns."""
    return [
        row
        for row in rows
        if row["kind"] in kinds and all(row[name] == value for name, value in columns.items())
    ]


def distinct(rows: Iterable[Row], column: str) -> list[str]:
    """The values of a column in the order in which they come."""
    return list(dict.fromkeys(row[column] for row in rows))


def least(rows: Iterable[Row]) -> str:
    """Least clearance in per cent of the keep-out radius."""
    return f"{min(100 * float(row['least_clearance']) / float(row['radius']) for row in rows):.2f} %"


def arms(rows: list[Row]) -> str:
    """One sphere: every arm over all attacks."""
    header = (
        "shield, control steps, episodes, violated episodes, violated steps, least clearance, crashes, lost"
    )
    body = []
    for arm in distinct(kind(rows, "attack"), "arm"):
        part = kind(rows, "attack", arm=arm)
        steps, episodes = total(part, "steps"), total(part, "episodes")
        body.append(
            [
                NAMES[arm],
                f"{steps:,}",
                f"{episodes:,}",
                rate(total(part, "violated_episodes"), episodes),
                rate(total(part, "violated_steps"), steps),
                least(part),
                rate(total(part, "crashes"), episodes),
                f"{total(part, 'out_of_bounds'):,}",
            ]
        )
    return markdown(header.split(", "), body)


def by(column: str, title: str):
    """One sphere: the sampled shield by one column, beside the violated episodes of the other arms."""
    header = f"{title}, control steps, violated steps, episodes, violated episodes, least clearance, "
    header += "refused, stopped, uncertified, (33): violated, none: violated"

    def table(rows: list[Row]) -> str:
        attacks = kind(rows, "attack")
        return markdown(header.split(", "), [line(attacks, value) for value in distinct(attacks, column)])

    def line(attacks: list[Row], value: str) -> list[str]:
        of_arm = {arm: kind(attacks, "attack", arm=arm, **{column: value}) for arm in NAMES}
        part = of_arm["sampled"]
        steps, episodes = total(part, "steps"), total(part, "episodes")
        return [
            value,
            f"{steps:,}",
            rate(total(part, "violated_steps"), steps),
            f"{episodes:,}",
            rate(total(part, "violated_episodes"), episodes),
            least(part),
            *(share(total(part, name), steps) for name in ("refused", "stopped", "uncertified")),
            *(
                share(total(of_arm[arm], "violated_episodes"), total(of_arm[arm], "episodes"))
                for arm in ("cbf", "none")
            ),
        ]

    return table


def forest(rows: list[Row]) -> str:
    """Many spheres: shielded flights beside the same flights without a shield."""
    header = (
        "spheres, command m/s, flights, violated flights, without shield, least clearance, speed kept, stuck, "
    )
    header += "refused, stopped, uncertified"
    part, body = kind(rows, "forest"), []
    for spheres in distinct(part, "spheres"):
        for speeds in (["1"], ["2"], ["1", "2"]):
            body.append(
                forest_line([row for row in kind(part, "forest", spheres=spheres) if row["speed"] in speeds])
            )
    return markdown(header.split(", "), body)


def forest_line(rows: list[Row]) -> list[str]:
    """One line of the forest's table."""
    bare, safe = kind(rows, "forest", arm="none"), kind(rows, "forest", arm="sampled")
    flights, steps = total(safe, "episodes"), total(safe, "steps")
    speeds = [sum(float(row["mean_speed"]) * int(row["episodes"]) for row in part) for part in (safe, bare)]
    return [
        safe[0]["spheres"],
        " and ".join(sorted(set(distinct(safe, "speed")))),
        f"{flights:,}",
        rate(total(safe, "violated_episodes"), flights),
        share(total(bare, "violated_episodes"), total(bare, "episodes")),
        f"{1000 * min(float(row['least_clearance']) for row in safe):.2f} mm",
        f"{100 * speeds[0] / speeds[1]:.1f} %",
        rate(total(safe, "stuck"), flights),
        *(share(total(safe, name), steps) for name in ("refused", "stopped", "uncertified")),
    ]


def chain(rows: list[Row]) -> str:
    """The bare chain, by order."""
    body = []
    for order in "1234":
        part = kind(rows, f"chain {order}")
        steps = total(part, "steps")
        margin = min(float(row["least_clearance"]) for row in part)
        body.append(
            [
                order,
                f"{steps:,}",
                rate(total(part, "violated_steps"), steps),
                f"{margin:.0e} m" if margin else "0",
            ]
        )
    return markdown(["order", "sampled steps", "violated steps", "least margin"], body)


def border(rows: list[Row]) -> str:
    """The border of the set, by order."""
    body = []
    for order in "1234":
        inside, outside = (kind(rows, f"border {order}", arm=arm)[0] for arm in ("inside", "outside"))
        samples, kept = int(outside["episodes"]), int(outside["episodes"]) - int(outside["violated_episodes"])
        body.append(
            [order, f"{samples:,}", rate(int(inside["violated_episodes"]), samples), rate(kept, samples)]
        )
    return markdown(["order", "samples on each side", "inside and lost", "outside and kept"], body)


def yaw(title: str, *labels: Callable[[Row], str]):
    """Attacks by the yaw motion: a line for every label, beside the same attacks without a shield."""
    header = f"{title}, control steps, episodes, violated steps, certificates lost, uncertified, crashes, "
    header += (
        "beyond the yaw range, least clearance, measured: violated, measured: certificates lost, none: violated"
    )

    def table(rows: list[Row]) -> str:
        parts: dict[str, list[Row]] = {}
        for label, row in product(labels, kind(rows, "yaw")):
            parts.setdefault(label(row), []).append(row)
        return markdown(header.split(", "), [yaw_line(name, part) for name, part in parts.items()])

    return table


def yaw_line(label: str, rows: list[Row]) -> list[str]:
    """One line of the table of yaw."""
    safe, measured, bare = (kind(rows, "yaw", arm=arm) for arm in ("sampled", "measured", "none"))
    steps, episodes = total(safe, "steps"), total(safe, "episodes")
    return [
        label,
        f"{steps:,}",
        f"{episodes:,}",
        rate(total(safe, "violated_steps"), steps),
        *(f"{total(safe, name):,}" for name in ("lost_certificates", "uncertified", "crashes", "spinning")),
        f"{1000 * min(float(row['least_clearance']) for row in safe):.2f} mm",
        violated_share(measured),
        f"{total(measured, 'lost_certificates'):,}" if measured else "–",
        violated_share(bare),
    ]


def violated_share(rows: list[Row]) -> str:
    """Share of violated episodes, a dash where none was flown."""
    return share(total(rows, "violated_episodes"), total(rows, "episodes")) if rows else "–"


def labelled(column: str) -> Callable[[Row], str]:
    """The name of a column with its value."""
    return lambda row: f"{column}: {row[column]}".replace("J_x ≠ J_y", r"$J_x \ne J_y$")


def revisions(rows: list[Row]) -> str:
    """What was measured, and how long it took."""
    seconds = sum(float(row["seconds"]) for row in rows)
    found = ", ".join(distinct(rows, "revision"))
    return f"Revision {found}; {seconds / 60:.0f} minutes of one core."


TABLES: dict[str, Callable[[list[Row]], str]] = {
    "revision": revisions,
    "arms": arms,
    "by attack": by("attack", "attack"),
    "by rate": by("rate", "rate Hz"),
    "by action": by("action", "interface"),
    "forest": forest,
    "yaw": yaw("part", lambda _: "all", *map(labelled, ("attack", "action", "vehicle", "conditions", "task"))),
    "yaw by rate": yaw("physics / control Hz", lambda row: f"{row['physics']} / {row['rate']}"),
    "chain": chain,
    "border": border,
}
