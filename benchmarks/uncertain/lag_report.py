"""The tables of docs/robustness.md behind rotors that lag, and their picture, from the results."""

from pathlib import Path

from safety_campaign.tables import Row, filled, markdown, rate

from uncertain.report import line, rows_with

ROTORS = {"wrench": "wrench", "four": "four rotors", "uneven": "four, uneven"}
ARMS = {
    "nothing": ("told of nothing", "#d55e00"),
    "shield": ("the shield is told", "#e69f00"),
    "both": ("shield and controller are told", "#0072b2"),
    "declared": ("the shield is told 37.5 ms", "#009e73"),
}
SIZES = ("flights", "control steps")


def write(rows: list[Row], page: Path, figure: Path) -> None:
    """Fill in the tables of the page, and draw."""
    makers = {"lagged body": body_table, "lagged snaps": snap_table, "lagged arms": arm_table}
    page.write_text(filled(page.read_text(encoding="utf-8"), rows, makers), encoding="utf-8")
    draw(rows, figure)


def counted(rows: list[Row], *columns: str) -> list[str]:
    """Sums of counts of flights, with their shares."""
    episodes = sum(int(row["episodes"]) for row in rows)
    return [rate(sum(int(row[column]) for row in rows), episodes) for column in columns]


def sizes(rows: list[Row]) -> list[str]:
    """Flights and control steps of rows."""
    return [f"{sum(int(row[name]) for row in rows):,}" for name in ("episodes", "steps")]


def body_table(rows: list[Row]) -> str:
    """Velocity commands, told: one line of all rates for a lag, in which any rate with a count is named."""
    header = ("bodies", "rotors", "T, ms", "Hz", *SIZES, "violated", "certificate lost", "not told: violated")
    body = []
    for bodies in ("spheres", "shapes"):
        for rotors, name in ROTORS.items():
            part = rows_with(rows, action="velocity", arm="both", bodies=bodies, rotors=rotors)
            main = [row for row in part if is_of_the_table(row)]
            for level in sorted({float(row["level"]) for row in main}):
                same = [row for row in main if float(row["level"]) == level]
                same.sort(key=lambda row: int(row["rate"]))
                rates = ", ".join(row["rate"] for row in same)
                cells = [bodies, name, f"{level:g}", rates, *sizes(same), *counted(same, "violated_episodes")]
                lost = [f"{row['uncertified_episodes']} at {row['rate']} Hz" for row in same if has_lost(row)]
                untold = rows_with(rows, arm="nothing", bodies=bodies, rotors=rotors, level=f"{level:g}")
                counts = counted(untold, "violated_episodes") if untold else ["–"]
                body.append([*cells, ", ".join(lost) or counted(same, "uncertified_episodes")[0], *counts])
    return markdown(header, body)


def is_of_the_table(row: Row) -> bool:
    """Whether a lag is one of the table, and not of the picture alone."""
    return float(row["level"]) in (10.0, 20.0, 37.5, 50.0, 72.0)


def has_lost(row: Row) -> bool:
    """Whether a flight of it lost its certificate."""
    return int(row["uncertified_episodes"]) > 0


def snap_table(rows: list[Row]) -> str:
    """Snap commands, told."""
    header = ("bodies", "rotors", "T, ms", *SIZES, "violated", "certificate lost", "rotor at a stop")
    body = [
        [
            row["bodies"],
            ROTORS[row["rotors"]],
            row["level"],
            *sizes([row]),
            *counted([row], "violated_episodes", "uncertified_episodes", "saturated_episodes"),
        ]
        for row in rows_with(rows, action="snap", arm="both")
    ]
    return markdown(header, body)


def arm_table(rows: list[Row]) -> str:
    """The picture in numbers: flights violated, and those that lost the certificate."""
    found = {arm: {float(row["level"]): row for row in drawn(rows, arm)} for arm in ARMS}
    body = [
        [f"{level:g}", *(pair(found[arm][level]) if level in found[arm] else "–" for arm in ARMS)]
        for level in sorted(set().union(*found.values()))
    ]
    return markdown(("T, ms", *(name for name, _ in ARMS.values())), body)


def pair(row: Row) -> str:
    """Shares of flights violated, and without a certificate, in per cent."""
    shares = [
        100 * int(row[name]) / int(row["episodes"]) for name in ("violated_episodes", "uncertified_episodes")
    ]
    return " / ".join(f"{share:.3g}" for share in shares)


def drawn(rows: list[Row], arm: str) -> list[Row]:
    """Rows of an arm in the picture, by lag."""
    found = rows_with(rows, action="velocity", bodies="spheres", rotors="wrench", arm=arm, rate="100")
    return sorted(found, key=lambda row: float(row["level"]))


def draw(rows: list[Row], path: Path) -> None:
    """Flights with a violation over the lag of the rotors."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
    for arm, (label, color) in ARMS.items():
        line(axis, drawn(rows, arm), 1.0, color, label)
    axis.axvline(37.5, color="#70757d", ls=":", lw=1.2)
    axis.set_xlabel("rotor lag, ms")
    axis.set_ylabel("flights with a violation, %")
    axis.spines[["top", "right"]].set_visible(False)
    axis.legend(frameon=False)
    figure.savefig(path, dpi=130)
