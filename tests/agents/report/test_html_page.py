"""report.html, made of the files of a run, and opened in a real browser."""

import shutil
import subprocess
import sys

import numpy as np
import pytest
from browser import Browser, needs_chromium, opened
from made_run import MOVES, made_run

from agents.experiment.runs import open_run
from agents.measure.trace import read_trace, vectors
from agents.report.reporting import write_report

FIGURES = ["learning", "violations", "logged", "forest", "clearance", "flights", "timeline"]
# What is seen of each figure: traces with a line or a point, and the objects in its space.
MARKS = """[...document.querySelectorAll('.js-plotly-plot')].map(figure => [
    figure.id.replace('figure-', ''),
    [...figure.querySelectorAll('.scatterlayer .trace')].filter(trace =>
        [...trace.querySelectorAll('.js-line, .point')].some(path =>
            path.getTotalLength() > 1 && parseFloat(getComputedStyle(path).strokeWidth) > 0)).length,
    figure._fullLayout.scene ? figure._fullLayout.scene._scene.glplot.objects.length : 0])"""
# Spheres are grey, the collision is red: anything but the white ground is a picture.
PAINTED = """Plotly.toImage('figure-flights', {format: 'png', width: 400, height: 300}).then(address => {
    const image = new Image();
    return new Promise(done => { image.onload = () => {
        const canvas = Object.assign(document.createElement('canvas'), {width: 400, height: 300});
        const context = canvas.getContext('2d');
        context.drawImage(image, 0, 0);
        const {data} = context.getImageData(0, 0, 400, 300);
        let painted = 0;
        for (let i = 0; i < data.length; i += 4)
            painted += data[i + 3] > 0 && Math.min(data[i], data[i + 1], data[i + 2]) < 225;
        done(painted / 120000);
    }; image.src = address; });
})"""

# What is said with the slider at a share of its way, the time, and where moving bodies and vehicles are.
PLAYED = """(share => {
    const figure = document.getElementById('figure-flights'), slider = document.querySelector('.player input');
    slider.value = share * slider.max;
    slider.dispatchEvent(new Event('input'));
    const shown = figure._fullData.filter(({meta}) => meta && (meta.velocity || meta.time.length === 1));
    return [document.querySelector('.player output').innerText, Number(slider.value),
        ...shown.map(({x, y, z}) => [x[0], y[0], z[0]])];
})(%s)"""
# Texts of a figure that are drawn over each other.
TOUCHING = """[...document.querySelectorAll('.js-plotly-plot')].flatMap(figure => {
    const texts = [...figure.querySelectorAll('text')].filter(text => text.textContent.trim());
    const boxes = texts.map(text => text.getBoundingClientRect());
    return texts.flatMap((text, i) => texts.slice(0, i).filter((other, j) =>
        Math.min(boxes[i].right, boxes[j].right) - Math.max(boxes[i].left, boxes[j].left) > 1 &&
        Math.min(boxes[i].bottom, boxes[j].bottom) - Math.max(boxes[i].top, boxes[j].top) > 1
    ).map(other => `${figure.id}: ${text.textContent} | ${other.textContent}`));
})"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    arms = ("none", "collision-penalty", "shield", "shield-penalty", "cbf", "tracker", "random")
    run = made_run(tmp_path_factory.mktemp("run"), arms)
    write_report(run)
    return run


def test_the_report_is_made_again_from_the_raw_files_byte_for_byte(run, tmp_path):
    made = ("seeds.csv", "results.csv", "results.txt", "report.html")
    copy = tmp_path / "copy"
    shutil.copytree(run.folder, copy, ignore=shutil.ignore_patterns(*made))
    write_report(open_run(copy))
    for name in made:
        old, new = ((folder / name).read_text().replace(str(folder), "") for folder in (run.folder, copy))
        assert old == new, name


def test_the_page_holds_all_that_it_needs(run):
    page = (run.folder / "report.html").read_text()
    outside_scripts = "".join(part.split("</script>")[-1] for part in page.split("<script"))
    assert "http" not in outside_scripts and " src=" not in outside_scripts and "@import" not in outside_scripts
    assert len(page) < 6_000_000


@pytest.mark.parametrize(
    "having",
    [
        {"arms": ("none",), "n_seeds": 1},
        {"is_flown": False, "is_traced": False},
        {"arms": ("tracker",), "is_flown": False, "is_traced": False},
    ],
)
def test_part_of_a_run_has_a_report_too(tmp_path, having):
    write_report(made_run(tmp_path, **having))
    assert "</html>" in (tmp_path / "report.html").read_text()


def test_names_and_records_are_escaped(tmp_path):
    run = made_run(tmp_path, n_seeds=1, is_flown=False, is_traced=False)
    (tmp_path / "provenance.yml").write_text("note: <script>alert(1)</script> & more\n")
    write_report(run)
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; more" in (tmp_path / "report.html").read_text()


def test_help_does_not_load_plotly():
    code = "import sys, train; from agents.experiment import command_line; sys.exit('plotly' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
@needs_chromium
@pytest.mark.parametrize("width", [1200, 390])
def test_a_browser_draws_every_figure_without_errors_and_without_a_network(run, tmp_path, width):
    with Browser(tmp_path / "profile") as browser:
        browser.open(run.folder / "report.html", width)
        browser.until(f"document.querySelectorAll('.js-plotly-plot .main-svg').length >= {3 * len(FIGURES)}")
        marks = {name: (traces, objects) for name, traces, objects in browser.ask(MARKS)}
        painted = browser.ask(PAINTED)
        pictures = [browser.screenshot(tmp_path / f"{name}.png", f"#figure-{name}") for name in FIGURES]
        browser.screenshot(tmp_path / "page.png", "body")
        touching = browser.ask(TOUCHING)
        early, late, after = (browser.ask(PLAYED % share) for share in (0.25, 0.5, 1.0))
        scrolled = browser.ask("document.documentElement.scrollWidth")
        assert browser.errors == []
        assert browser.requests == [(run.folder / "report.html").as_uri()]
    assert list(marks) == FIGURES
    # Two spheres, three paths, three points.
    assert marks.pop("flights")[1] >= 8 and painted > 0.05
    seen = {"learning": 5, "violations": 5, "logged": 3 * 5, "forest": 2 * 7 * 4 - 2, "clearance": 2 * 7}
    seen["timeline"] = 2 * 3 + 2
    # reference to itself, and a curve each; three snaps desired and applied, two clearances.
    seen = {
        "learning": 5,
        "violations": 5,
        "logged": 3 * 5,
        "forest": 2 * 7 * 4 - 2,
        "clearance": 2 * 7,
        "timeline": 2 * 3 + 2,
    }
    assert {name: traces for name, (traces, _) in marks.items()} == seen
    assert all(picture.stat().st_size > 5_000 for picture in pictures)
    assert scrolled <= width and touching == []
    moves_as_the_trace(read_trace(run), early, late, after)


def moves_as_the_trace(trace, early, late, after):
    """Vehicles and bodies are where they were at the time of the slider; who collided stays there."""
    for words, time, *bodies, off, on in (early, late, after):
        assert words.startswith(f"{time:.2f} s")
        for point, steps in ((off, trace.without), (on, trace.shielded)):
            expected = [np.interp(time, steps["time"], column) for column in vectors(steps, "position").T]
            assert point == pytest.approx(expected, abs=2e-4)
        for body, drawn in zip(bodies, early[2:-2], strict=True):
            way = (time - early[1]) * np.array(MOVES)
            assert body == pytest.approx(np.array(drawn) + way, abs=1e-6) and len(bodies) == 2
    assert early[-1] != pytest.approx(late[-1], abs=0.1) and late[-2] == after[-2]
    assert "the shield acts" in early[0] and "collided" not in early[0] and "collided" in after[0]


@needs_chromium
def test_the_browser_tells_errors_and_requests(tmp_path):
    page = tmp_path / "page.html"
    page.write_text(
        "<script>console.error('told')</script><img src='there_is_none.png'><script>fail()</script>"
    )
    told = opened(page, tmp_path / "profile", 800)
    assert all(word in " ".join(told.errors) for word in ("told", "fail is not defined", "ERR_FILE_NOT_FOUND"))
    assert told.requests == [page.as_uri(), (tmp_path / "there_is_none.png").as_uri()]
    assert "<img" in told.dom
