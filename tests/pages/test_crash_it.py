"""The page "Try to crash it" in a browser: it is flown by keys and thumbs, and attacked."""

import importlib.metadata
import importlib.util
import json

import numpy as np
import pytest
from browser import Browser, needs_chromium
from house import ROOT, script

from quadsafe_core.shapes.obstacles import Obstacles

FOLDER = ROOT / "docs" / "crash-it"
PAGE = FOLDER / "index.html"
ZIGLANG = "0.17.1"
BUTTONS = ["shield", "attack", "time", "next", "help"]
# Those that a thumb may not reach: off the screen, or under another thing.
UNREACHABLE = """[...document.querySelectorAll('nav button, .pad')].filter((each) => {
    const box = each.getBoundingClientRect(), x = box.x + box.width / 2, y = box.y + box.height / 2;
    return box.x < 0 || box.right > innerWidth || box.y < 0 || box.bottom > innerHeight
        || !each.contains(document.elementFromPoint(x, y));
}).map((each) => each.id)"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


def begun(browser, width, height):
    browser.open(PAGE, width, height)
    browser.until("page.work.length > 0")
    return browser


# A small one is drawn fast without a graphics card.
@pytest.fixture(scope="module")
def page(browser):
    return begun(browser, 560, 320)


@pytest.fixture
def page_anew(browser):
    return begun(browser, 560, 320)


def key(browser, code, *kinds, text=""):
    name = " " if code == "Space" else code if text in ("", "\r") else text
    for kind in kinds or ("keyDown", "keyUp"):
        pressed = {"code": code, "key": name, "windowsVirtualKeyCode": 32 if code == "Space" else 0}
        browser.call("Input.dispatchKeyEvent", type=kind, text=text if kind == "keyDown" else "", **pressed)


def touch(browser, kind, *point):
    points = [dict(zip("xy", point, strict=True))] if point else []
    browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)


@needs_chromium
def test_a_pilot_that_flies_at_the_nearest_shape_crashes_without_the_shield_and_never_with_it(page):
    found = page.ask("attackFlights(200, 300)")
    assert (found["with"], found["uncertified"]) == (0, 0)
    assert found["clearance"] > 0.0 and found["acted"] > 10_000
    assert found["without"] == 200
    assert page.errors == []


@needs_chromium
def test_the_plant_has_the_distances_of_the_package(page):
    random = np.random.default_rng(0)
    rows = [*random.uniform(-1.0, 1.0, (2, 3)), 0.3]
    scene = [
        {"shape": "sphere", "center": rows[0].tolist(), "radius": 0.4},
        {"shape": "capsule", "start": rows[0].tolist(), "end": rows[1].tolist(), "radius": 0.3},
        {"shape": "cylinder", "start": rows[0].tolist(), "end": rows[1].tolist(), "radius": 0.3},
        {
            "shape": "box",
            "center": rows[1].tolist(),
            "size": [0.5, 0.7, 0.9],
            "rotation": np.linalg.qr(random.normal(size=(3, 3)))[0].tolist(),
        },
        {"shape": "half_space", "normal": [0.6, 0.0, 0.8], "offset": -0.2},
    ]
    rotation = np.array(scene[3]["rotation"])
    scene[3]["rotation"] = (rotation * np.sign(np.linalg.det(rotation))).tolist()
    points = random.uniform(-2.0, 2.0, (200, 3))
    page.ask(f"window.other = new Engine(), other.load({{radius: 0, shapes: {json.dumps(scene)}}})")
    told = page.ask(
        f"{json.dumps(points.tolist())}.map((p) => [0, 1, 2, 3, 4].map((k) => other.c.distance(k, ...p)))"
    )
    expected = np.stack([shape.distance(points) for shape in Obstacles.pack(scene)], axis=-1)
    assert (expected < 0.0).any(axis=0).all()
    # Roundings of lengths of a few metres.
    np.testing.assert_allclose(told, expected, rtol=0.0, atol=1e-14)


@needs_chromium
def test_the_page_draws_correction_stop_and_path_and_counts_crashes_of_the_bare_one(page):
    page.ask("page.press('attack')")
    page.until("page.view.arrow.visible")
    assert page.ask("page.view.stop.geometry.drawRange.count") > 1
    assert page.ask("page.view.path.geometry.drawRange.count") > 1
    page.until("page.game.crashes.without > 0")
    assert page.ask("document.getElementById('without').textContent") != "0"
    assert page.ask("document.getElementById('with').textContent") == "0"


@needs_chromium
def test_the_stored_stop_ends_at_rest_clear_of_every_shape(page):
    ends = page.ask("""(() => {
        const engine = new Engine(), found = [];
        engine.load(SCENES[0]);
        engine.c.place(0, ...SCENES[0].start);
        for (let period = 0; period < 100; ++period) {
            engine.step(0, [2, 0.5, 0], true);
            const count = engine.c.stop(0), line = engine.line.slice(0, 3 * count);
            for (let n = 0; n < count; ++n) {
                const point = line.slice(3 * n, 3 * n + 3);
                found.push(Math.min(...SCENES[0].shapes.map((_, k) => engine.c.distance(k, ...point))));
            }
        }
        return [found.length, Math.min(...found) - SCENES[0].radius];
    })()""")
    assert ends[0] > 800 and ends[1] > 0.0


@needs_chromium
def test_a_shield_that_is_put_before_a_wall_at_full_speed_is_not_blamed(page):
    told = page.ask("""(() => {
        const engine = new Engine(), game = new Game(engine);
        game.toggle();
        while (engine.clearance(BARE) > 0.02 || engine.velocity(BARE)[0] < 1.5) game.flyBare([2, 0, 0]);
        game.toggle();
        while (game.crashes.without === 0) game.flyShielded([2, 0, 0]);
        return [game.crashes, game.isEngaged];
    })()""")
    assert told == [{"with": 0, "without": 1}, False]


@needs_chromium
def test_the_page_asks_for_nothing_outside_its_folder(page):
    assert [url for url in page.requests if not url.startswith(FOLDER.as_uri())] == []


@needs_chromium
def test_the_keyboard_alone_flies_and_reaches_every_button(page_anew):
    page = page_anew
    start = page.ask("[...page.engine.position(SHIELDED)]")
    for code, axis in (("KeyW", 0), ("KeyA", 1), ("Space", 2)):
        key(page, code, "keyDown", text=" " if code == "Space" else "")
        page.until(f"page.engine.position(SHIELDED)[{axis}] > {start[axis] + 0.05}")
        key(page, code, "keyUp")
    key(page, "KeyE", text="e")
    assert page.ask("[page.game.isOn, document.getElementById('shield').ariaPressed]") == [False, "false"]
    key(page, "KeyN", text="n")
    assert page.ask("page.game.number") == 1
    for button in BUTTONS:
        key(page, "Tab")
        assert page.ask("document.activeElement.id") == button
        assert page.ask("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    # What is open next gets the focus next, and the one that opened it back.
    key(page, "Enter", text="\r")
    key(page, "Tab")
    assert page.ask("document.activeElement.id") == "close"
    key(page, "Escape")
    assert page.ask("[document.activeElement.id, document.getElementById('words').hidden]") == ["help", True]
    assert page.errors == []


@needs_chromium
def test_a_button_that_has_the_focus_keeps_the_space_bar(page_anew):
    page = page_anew
    key(page, "Tab")
    key(page, "Space", "keyDown", text=" ")
    assert page.ask("page.pilot.held.size") == 0
    key(page, "Space", "keyUp")
    assert page.ask("page.game.isOn") is False


@needs_chromium
def test_a_gamepad_flies_and_its_buttons_press_once(page_anew):
    page = page_anew
    page.ask("window.pad = { axes: [0.05, -1, 0, 0], buttons: [{ pressed: false }, { pressed: false }] }, 0")
    # A browser tells of a gamepad in a list with empty places.
    page.ask("navigator.getGamepads = () => [null, window.pad], 0")
    start = page.ask("page.engine.position(SHIELDED)[0]")
    page.until(f"page.engine.position(SHIELDED)[0] > {start + 0.05}")
    # A stick that rests a little beside its middle asks for nothing, and up on it is minus one.
    assert page.ask("page.pilot.asked()") == {"forward": 1, "left": 0, "up": 0, "turn": 0}
    page.ask("window.pad = { axes: [0, 0, 0.5, -1], buttons: [{ pressed: true }] }, 0")
    page.until("page.game.isOn === false")
    assert page.ask("page.pilot.asked()") == {"forward": 0, "left": 0, "up": 1, "turn": -0.5}
    page.ask("[...Array(9)].forEach(() => page.pilot.asked()), 0")
    assert page.ask("page.game.isOn") is False
    page.ask(
        "window.pad.buttons[0].pressed = false, page.pilot.asked(), window.pad.buttons[0].pressed = true, 0"
    )
    page.until("page.game.isOn === true")
    assert page.errors == []


@needs_chromium
def test_a_phone_shows_all_of_it_and_thumbs_fly(browser):
    begun(browser, 390, 844)
    browser.call("Emulation.setTouchEmulationEnabled", enabled=True)
    assert browser.ask(UNREACHABLE) == []
    assert browser.ask("document.documentElement.scrollWidth") == 390
    box = browser.ask("document.getElementById('left-pad').getBoundingClientRect().toJSON()")
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    start = browser.ask("page.engine.position(SHIELDED)[0]")
    touch(browser, "touchStart", x, y)
    touch(browser, "touchMove", x, box["y"] + 4)
    browser.until(f"page.engine.position(SHIELDED)[0] > {start + 0.05}")
    touch(browser, "touchEnd")
    assert browser.ask("page.pilot.asked()") == {"forward": 0, "left": 0, "up": 0, "turn": 0}
    browser.call("Emulation.setTouchEmulationEnabled", enabled=False)
    assert browser.errors == []


def test_all_of_it_is_a_megabyte_at_most():
    assert sum(file.stat().st_size for file in FOLDER.iterdir()) <= 1_000_000


def test_the_scenes_are_those_of_the_environments():
    with script("c/page", "scenes_script") as scenes_script:
        assert (FOLDER / "scenes.js").read_text() == scenes_script.script()


# A new cache of the compiler takes half a minute.
@pytest.mark.slow
def test_the_module_is_the_one_that_the_sources_give():
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("needs the C compiler of the wheel ziglang")
    if importlib.metadata.version("ziglang") != ZIGLANG:
        pytest.skip(f"the module that is kept was compiled by ziglang {ZIGLANG}")
    with script("c/page", "shield_script") as shield_script:
        assert (FOLDER / "shield.js").read_text() == shield_script.script(shield_script.compiled())
