"""The tables of docs/safety.md about shapes, rooms and gates, from the results."""

from collections.abc import Callable, Iterable

from safety_campaign.tables import Row, distinct, kind, markdown, rate, share, total, violated_share


def millimetres(rows: Iterable[Row]) -> str:
    """Least clearance."""
    return f"{1000 * min(float(row['least_clearance']) for row in rows):.2f} mm"


def shapes(title: str, *labels: Callable[[Row], str]) -> Callable[[list[Row]], str]:
    """Attacks among shapes: a line for every label, beside the same attacks without a shield."""
    header = f"{title}, control steps, episodes, violated steps, violated episodes, least clearance, refused, "
    header += "stopped, uncertified, no stop at the start, none: violated"

    def table(rows: list[Row]) -> str:
        parts: dict[str, list[Row]] = {}
        for label in labels:
            for row in kind(rows, "shapes"):
                parts.setdefault(label(row), []).append(row)
        return markdown(header.split(", "), [shape_line(name, part) for name, part in parts.items()])

    return table


def shape_line(label: str, rows: list[Row]) -> list[str]:
    """One line of the tables of shapes."""
    safe, bare = kind(rows, "shapes", arm="sampled"), kind(rows, "shapes", arm="none")
    steps, episodes = total(safe, "steps"), total(safe, "episodes")
    return [
        label,
        f"{steps:,}",
        f"{episodes:,}",
        rate(total(safe, "violated_steps"), steps),
        rate(total(safe, "violated_episodes"), episodes),
        millimetres(safe),
        *(share(total(safe, name), steps) for name in ("refused", "stopped", "uncertified")),
        f"{total(safe, 'stuck'):,}",
        violated_share(bare),
    ]


def courses(rows: list[Row]) -> str:
    """Rooms and gates: shielded flights beside the same flights without a shield."""
    header = "scene, pilot, opening, bodies, flights, violated flights, none: violated, uncertified, "
    header += "least clearance, speed kept, arrived"
    part, body = kind(rows, "course"), []
    for task in distinct(part, "task"):
        for pilot in distinct(part, "attack"):
            one = kind(part, "course", task=task, attack=pilot)
            places = dict.fromkeys((row["radius"], row["spheres"]) for row in one)
            body += [
                course_line(kind(one, "course", radius=opening, spheres=bodies)) for opening, bodies in places
            ]
    return markdown(header.split(", "), body)


def course_line(rows: list[Row]) -> list[str]:
    """One line of the table of courses."""
    safe, bare = kind(rows, "course", arm="sampled"), kind(rows, "course", arm="none")
    flights = total(safe, "episodes")
    speeds = [sum(float(row["mean_speed"]) for row in part) / len(part) for part in (safe, bare)]
    first = safe[0]
    # Of each vehicle the first flight counts.
    firsts = 200 * len(safe)
    arrived = f"{100 * (1 - total(safe, 'stuck') / firsts):.1f} %" if first["attack"] == "follower" else "–"
    return [
        first["task"],
        first["attack"],
        f"{float(first['radius']):.2f} m",
        first["spheres"],
        f"{flights:,}",
        rate(total(safe, "violated_episodes"), flights),
        violated_share(bare),
        share(total(safe, "uncertified"), total(safe, "steps")),
        millimetres(safe),
        f"{100 * speeds[0] / speeds[1]:.1f} %",
        arrived,
    ]


def motion(row: Row) -> str:
    """Whether shapes move, and how fast."""
    return f"at {row['speed']} m/s" if float(row["speed"]) else "at rest"


TABLES: dict[str, Callable[[list[Row]], str]] = {
    "shapes": shapes("shapes", lambda _: "all", lambda row: row["attack"].replace("_", "-"), motion),
    "shapes by rate": shapes("rate Hz", lambda row: row["rate"]),
    "shapes by action": shapes("interface", lambda row: row["action"]),
    "courses": courses,
}
