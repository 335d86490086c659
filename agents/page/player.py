"""A button, a slider and a line of words that play a figure of flights.

The figure tells what to play. Its layout has in ``meta`` what each flight is called, and row by row its time,
position and clearance, in s and m, and whether the shield acts. A trace with ``flight`` and ``time`` in
``meta`` has a point for each of these times, shown where the flight was then, or where it is now if that is
earlier. A trace with a ``velocity`` in ``meta`` is drawn as it was at 0 s, and moves from there.
"""

SCRIPT = """\
const playable = (figure, controls) => {
  const [button, slider, output] = controls.children, flights = Object.values(figure.layout.meta);
  const drawn = figure.data.map(({x, y, z}) => [x, y, z]), end = Number(slider.max);
  const row = ({time}, t) => Math.max(time.findLastIndex((own, i) => own <= t && i < time.length - 1), 0);
  const place = (flight, t) => {
    const i = row(flight, t), {time, position} = flight;
    const part = Math.min(Math.max((t - time[i]) / (time[i + 1] - time[i]), 0), 1);
    return position[i].map((from, k) => from + part * (position[i + 1][k] - from));
  };
  const columns = ({flight, time, velocity}, i, t) => {
    if (velocity) return velocity.map((v, k) => drawn[i][k].map(from => from + t * v));
    const places = time.map(own => own === null ? [null, null, null]
      : place(figure.layout.meta[flight], Math.min(own, t)));
    return [0, 1, 2].map(k => places.map(point => point[k]));
  };
  const words = (flight, t) => {
    const i = row(flight, t), last = flight.time.at(-1);
    const clearance = flight.clearance[i].toFixed(2).replace('-', '−');
    const over = `, ${flight.clearance.at(-1) < 0 ? 'collided' : 'ended'} at ${last.toFixed(2)} s`;
    const acts = flight.acts[i] ? ', the shield acts' : '';
    return `${flight.name}: clearance ${clearance} m${t < last ? acts : over}`;
  };
  const show = t => {
    const moving = figure.data.flatMap(({meta}, i) => meta ? [i] : []);
    const found = moving.map(i => columns(figure.data[i].meta, i, t));
    const [x, y, z] = [0, 1, 2].map(k => found.map(column => column[k]));
    output.replaceChildren(...[`${t.toFixed(2)} s`, ...flights.map(flight => words(flight, t))].map(text =>
      Object.assign(document.createElement('span'), {textContent: text})));
    return Plotly.restyle(figure, {x, y, z}, moving);
  };
  let started = null;
  const stop = () => { started = null; button.textContent = 'Play'; };
  const tick = async now => {
    if (started === null) return;
    const t = Math.min(Math.max((now - started) / 1000, 0), end);
    slider.value = t;
    await show(t);
    t < end ? requestAnimationFrame(tick) : stop();
  };
  button.onclick = () => {
    if (started !== null) return stop();
    started = performance.now() - 1000 * (slider.value >= end ? 0 : slider.value);
    button.textContent = 'Pause';
    requestAnimationFrame(tick);
  };
  slider.oninput = () => { stop(); show(Number(slider.value)); };
  show(end);
};
"""
LOOKS = """\
.player { display: flex; flex-wrap: wrap; gap: 6px 14px; align-items: center; margin: 8px 0 0; }
.player { font-size: 14px; }
.player button { font: inherit; font-weight: 600; width: 76px; padding: 5px 0; cursor: pointer; }
.player button { color: #22262b; background: #fff; border: 1px solid #6b7078; border-radius: 6px; }
.player input { flex: 1 1 220px; accent-color: #0072b2; margin: 0; }
.player output { flex: 1 0 100%; display: flex; flex-wrap: wrap; gap: 2px 22px; min-height: 1.6em; }
.player output { font-variant-numeric: tabular-nums; }
"""


def player(figure: str, end: float) -> str:
    """The controls of a figure.

    Args:
        figure: id of its element.
        end: time of the slider's right end, s.
    """
    return (
        '<div class="player"><button type="button">Play</button>'
        f'<input type="range" min="0" max="{end}" step="any" value="{end}" aria-label="time, s">'
        f"<output></output></div>\n<script>\n{{\n{SCRIPT}"
        "const controls = document.currentScript.previousElementSibling;\n"
        f"addEventListener('load', () => playable(document.getElementById('{figure}'), controls));\n"
        "}\n</script>"
    )
