"""Draw ``gap.svg``: a log, the model before and after its diagnosis, and what each misses.

cd examples/gimbal
servo-models diagnose gimbal.toml --out GAP.toml --report ../../docs/gap.html
python ../../docs/draw_gap.py
"""

from pathlib import Path

import numpy as np

import servo_models as sm

HERE = Path(__file__).parent
GIMBAL = HERE.parent / "examples" / "gimbal"
WIDTH, LEFT, RIGHT = 860, 64, 700
TOP, BOTTOM = (36, 246), (276, 376)  # of both diagrams
ANGLES, ERROR = (-5.0, 30.0), 2.2  # [deg]
BEGIN, END = 1.2, 3.18  # [s]

STYLE = """
    svg { --paper: #fdfdfc; --ink: #1d2329; --muted: #5a6570; --line: #d5dae0; --blue: #0072b2; --orange: #b54a05; }
    @media (prefers-color-scheme: dark) { svg { --paper: #171b20; --ink: #e4e8ec; --muted: #a3adb8; --line: #3a434d; --blue: #56b4e9; --orange: #f0954f; } }
    .page { fill: var(--paper); }
    text { font: 13px system-ui, -apple-system, "Segoe UI", Roboto, Arial, sans-serif; fill: var(--muted); }
    .grid { stroke: var(--line); }
    polyline { fill: none; stroke-width: 1.6; stroke-linejoin: round; }
    .command { stroke: var(--muted); stroke-width: 1.1; stroke-dasharray: 3 3; }
    circle { fill: var(--ink); }
    .before { stroke: var(--orange); }
    .after { stroke: var(--blue); }
    text.measured { fill: var(--ink); }
    text.before { fill: var(--orange); stroke: none; }
    text.after { fill: var(--blue); stroke: none; }
"""  # noqa: E501


def main() -> None:
    log = sm.read_description(GIMBAL / "gimbal.toml").logs[0]
    models = {
        "before": sm.model(str(GIMBAL / "gimbal.py")),
        "after": sm.read_parameters(GIMBAL / "GAP.toml").model(),
    }
    shown = (log.times >= BEGIN) & (log.times <= END)
    times, measured = log.times[shown], np.degrees(log.outputs["reading"])
    angles = {"command": np.degrees(log.inputs["command"])}
    for name, model in models.items():
        angles[name] = np.degrees(sm.simulate(model, log.times, log.inputs)["reading"])
    errors = {name: angles[name] - measured for name in models}
    lines = [
        *diagram(TOP, *ANGLES, (0, 10, 20, 30)),
        *(line(name, times, values[shown], TOP, *ANGLES) for name, values in angles.items()),
        *dots(times[::2], measured[shown][::2], TOP, *ANGLES),
        *diagram(BOTTOM, -ERROR, ERROR, (-2, 0, 2)),
        *(line(name, times, e[shown], BOTTOM, -ERROR, ERROR) for name, e in errors.items()),
    ]
    rms = {name: float(np.sqrt(np.mean(e * e))) for name, e in errors.items()}
    words = [
        (TOP[0] - 12, "", "angle [deg]", LEFT - 40),
        (BOTTOM[0] - 10, "", "error [deg]", LEFT - 40),
        (TOP[0] + 40, "measured", "measured, dots", RIGHT + 12),
        (TOP[0] + 62, "before", "model before", RIGHT + 12),
        (TOP[0] + 84, "after", "model after", RIGHT + 12),
        (TOP[0] + 106, "", "command, dashed", RIGHT + 12),
        (BOTTOM[0] + 40, "before", f"{rms['before']:.2f} deg RMS", RIGHT + 12),
        (BOTTOM[0] + 62, "after", f"{rms['after']:.3f} deg RMS", RIGHT + 12),
        (BOTTOM[0] + 84, "", "the noise: 0.05 deg", RIGHT + 12),
    ]
    texts = [f'<text x="{x}" y="{y}" class="{kind}">{text}</text>' for y, kind, text, x in words]
    texts += [
        f'<text x="{x_of(t):.0f}" y="{BOTTOM[1] + 18}" text-anchor="middle">{t} s</text>'
        for t in (1.5, 2.0, 2.5, 3.0)
    ]
    title = "A log of a gimbal, its model before and after the diagnosis, and the error of each"
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} 406" role="img">'
    page = f'<rect class="page" width="{WIDTH}" height="406" rx="10"/>'
    parts = [head, f"<title>{title}</title>", f"<style>{STYLE}</style>", page, *lines, *texts]
    (HERE / "gap.svg").write_text("\n".join([*parts, "</svg>", ""]), encoding="utf-8")


def x_of(time: float) -> float:
    return LEFT + (RIGHT - LEFT) * (time - BEGIN) / (END - BEGIN)


def y_of(value: float, ends: tuple[int, int], low: float, high: float) -> float:
    return ends[1] - (ends[1] - ends[0]) * (value - low) / (high - low)


def line(
    name: str, times: np.ndarray, values: np.ndarray, ends: tuple[int, int], low: float, high: float
) -> str:
    points = " ".join(
        f"{x_of(t):.1f},{y_of(v, ends, low, high):.1f}" for t, v in zip(times, values)
    )
    return f'<polyline class="{name}" points="{points}"/>'


def dots(
    times: np.ndarray, values: np.ndarray, ends: tuple[int, int], low: float, high: float
) -> list[str]:
    return [
        f'<circle cx="{x_of(t):.1f}" cy="{y_of(v, ends, low, high):.1f}" r="1.7"/>'
        for t, v in zip(times, values)
    ]


def diagram(ends: tuple[int, int], low: float, high: float, ticks: tuple[int, ...]) -> list[str]:
    heights = [(tick, y_of(tick, ends, low, high)) for tick in ticks]
    return [
        f'<path class="grid" d="M{LEFT} {y:.1f}H{RIGHT}"/>'
        f'<text x="{LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{tick}</text>'
        for tick, y in heights
    ]


if __name__ == "__main__":
    main()
