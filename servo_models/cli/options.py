"""Arguments that several commands share, with their shell completion."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import typer
from typer.models import OptionInfo

from servo_models.errors import UserError

if TYPE_CHECKING:
    from servo_models.core.simulate import Model
    from servo_models.report.result import Result


Format = Literal["text", "json", "github"]


def check_outputs(
    *outputs: tuple[Path | None, str], description: Path | None = None, read: Iterable[Path] = ()
) -> None:
    """Check the names and suffixes, "" for any, of files to write before long work."""
    from servo_models.data.schema import named_files
    from servo_models.files import check_writable

    inputs = [*read, *(named_files(description) if description else ())]
    for path, suffix in outputs:
        if path and suffix and path.suffix.lower() != suffix:
            raise UserError(f"'{path}': let the name end in {suffix}")
        if path and os.path.exists(path) and any(path.samefile(it) for it in inputs if it.exists()):
            raise UserError(f"'{path}' is read, not written: choose another name")
        if path:
            check_writable(path)


def chosen_model(
    actuator: str | None,
    variant: str | None,
    settings: list[str] | None,
    params: Path | None,
    trust: bool,
) -> Model:
    """Return the model of ``ACTUATOR --variant`` or ``--params``, with ``--set`` on top."""
    from servo_models.catalogue import model
    from servo_models.data.parameters import read_parameters

    overrides = assignments("--set", settings or ())
    if params:
        if actuator or variant:
            raise UserError("--params names actuator and variant itself: leave them out")
        return read_parameters(params, trust).model(overrides)
    if not actuator:
        raise UserError("no actuator: name one, see 'servo-models list', or give --params FILE")
    return model(actuator, variant, overrides)


def assignments(option: str, texts: Iterable[str]) -> dict[str, str]:
    """Return ``NAME=VALUE`` texts as a dictionary."""
    values: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise UserError(f"{option} '{text}': write NAME=VALUE, such as {option} {EXAMPLE}")
        if name in values:
            raise UserError(f"{option} '{name}' is given twice: keep one")
        values[name] = value
    return values


EXAMPLE = "load_torque='20 mN.m'"


def completing(names: Callable[[typer.Context], Iterable[str]]) -> Callable[..., list[str]]:
    """Return a shell completion from the names that fit a command line."""

    def complete(ctx: typer.Context, incomplete: str) -> list[str]:
        return [name for name in names(ctx) if name.startswith(incomplete)]

    return complete


def _actuators(_: Any = None) -> Mapping[str, Any]:
    from servo_models.catalogue import all_actuators

    return all_actuators()


def _simulators(_: Any) -> Iterable[str]:
    from servo_models.simulators import simulators

    return simulators()


def _names(_: Any) -> list[str]:
    from servo_models.effects import effects

    return [*_actuators(), *effects()]


def _typed(ctx: typer.Context) -> list[Any]:
    """The actuator on an unfinished command line, where it may not yet be parsed as an argument."""
    words: list[Any] = [ctx.params.get("actuator"), ctx.params.get("name"), *ctx.args]
    return [_actuators()[word] for word in words if word in _actuators()]


complete_actuator, complete_name = completing(_actuators), completing(_names)
complete_variant = completing(lambda ctx: (it.name for one in _typed(ctx) for it in one.variants))
complete_setting = completing(
    lambda ctx: (f"{name}=" for one in _typed(ctx) for name in one.plant.parameters)
)
complete_input = completing(
    lambda ctx: (f"{wire.name}=" for one in _typed(ctx) for wire in one.plant.settable)
)


def write_result(result: Result, *, json: Path | None = None, report: Path | None = None) -> None:
    """Write the files that ``--json`` and ``--report`` name."""
    from datetime import date

    from servo_models.files import write_whole

    if json:
        write_whole(json, f"{result.to_json()}\n".encode())
    if report:
        result.write_report(report, date.today().isoformat())


def _seconds(text: str) -> float:
    from servo_models.units import parse

    seconds = parse(text, "s")
    if not seconds > 0.0:
        raise UserError(f"'{text}' is no time above 0 s: give one such as 60s")
    return seconds


def _allow(megabytes: int | None) -> int | None:
    from servo_models.files import largest_input

    if megabytes is not None:
        largest_input.set(megabytes << 20)
    return megabytes


def _argument(about: str, metavar: str | None = None, complete: Any = None) -> Any:
    return typer.Argument(help=about, metavar=metavar, autocompletion=complete)


def _option(
    about: str, metavar: str | None = None, complete: Any = None, names: Any = ..., **more: Any
) -> Any:
    return typer.Option(names, help=about, metavar=metavar, autocompletion=complete, **more)


def _file(about: str) -> Any:
    return _option(about, "FILE")


def _time(about: str) -> Any:
    """An option that is a time [s], above 0."""
    return _option(about, "TIME", parser=_seconds)


MADE_BY = _option(
    "What made a log, see 'list': smart_servo, or with a variant smart_servo:sts3215.",
    complete=complete_actuator,
)
WORDS: Mapping[str, Any] = {
    "actuator": _argument(
        "An actuator, see 'list', or your own .py file.", complete=complete_actuator
    ),
    "description": _argument("Description of model and logs, see 'check LOG --init'."),
    "out": _file("Write the model as a parameter file (.toml)."),
    "json": _file("Write every figure, in SI (.json)."),
    "report": _file("Write a report with pictures (.html)."),
    "params": _file("Parameter file, .toml, in place of a name and variant."),
    "variant": _option("Parameter set, see 'list'.", complete=complete_variant),
    "set_": _option(
        "Change a parameter, in SI or with a unit; may be repeated.", "NAME=VALUE", complete_setting
    ),
    "format_": _option("How the result is printed."),
    "seed": _option("Seed of all that is random.", min=0),
    "jobs": _option("Simulations or cases at once; default: one a processor.", min=1),
    "trust": _option(
        "Run the Python file of the actuator even if it does not lie beside the file that"
        " names it, or if a survey found that file by itself."
    ),
    "largest": _option(
        "Largest file of measurements, also of what is unpacked from it; default 256.",
        "MB",
        min=1,
        callback=_allow,
    ),
    "blind.cases": _option("Number of cases, dealt to the tiers in turn.", min=1),
    "blind.tiers": _option("Tiers to draw from: easy, hard, poor, rough.", "TIER,TIER"),
    "blind.folder": _option(
        "Keep cases and results, to go on after an interruption; default: a temporary folder.",
        "DIR",
    ),
    "build.actuator": _argument(
        "An actuator, or your own .py file; default all.", complete=complete_actuator
    ),
    "build.out": _option("Folder of the FMUs, or one file .fmu.", "PATH"),
    "build.native": _option("Native FMUs alone; refused without a C compiler."),
    "build.fmi": _option("Version of FMI; what is of 3 is native.", "2|3", min=2, max=3),
    "check.file": _argument(
        "A description, .toml; with --init a log, or a robot's recording.", "FILE"
    ),
    "check.init": _option("Write a first description of a log, to be edited."),
    "check.out": _file(
        "Where to write it; default: beside the log, .toml. Of a recording: a folder."
    ),
    "check.actuator": MADE_BY,
    "compare.files": _argument("Diagnoses (.json) and parameter files (.toml).", "FILE..."),
    "compare.on": _option(
        "The logs; default: the description that a diagnosis names, beside its file.", "DESCRIPTION"
    ),
    "diagnose.map_": _file(
        "Write the diagnosed model with its residual map, where one is learnt (.toml)."
    ),
    "diagnose.signals": _file(
        "Write what was measured, simulated and is left (.csv, .parquet, or .mcap, with a"
        " layout of PlotJuggler beside it, .xml)."
    ),
    "diagnose.tolerance": _option("Gap in noise floors that counts as none; default 2.", min=0.0),
    "diagnose.quick": _option("Stop at the first answer: effects one at a time."),
    "diagnose.time_limit": _time("Stop after this time, such as 60s, and tell the best."),
    "explain.name": _argument(
        "An actuator, your own .py file, or an effect.", complete=complete_name
    ),
    "explain.picture": _file("Draw its response to .svg, .png or .pdf."),
    "explain.diagram": _file("Draw the block diagram of an actuator to .svg, .png or .pdf."),
    "explain.page": _file("Write a page that simulates it in a browser."),
    "explore.what": _argument(
        "An actuator, an effect, a description (.toml) or a log; default: all actuators.",
        "[NAME | FILE]",
        complete_actuator,
    ),
    "explore.out": _file(
        "The page that is written (.html); default: explore.html. With --serve the folder for"
        " all that is saved; default: NAME_explored, beside the file."
    ),
    "explore.actuator": MADE_BY,
    "explore.show": _option("Open the page in a browser.", names="--show/--no-show"),
    "explore.serve": _option(
        "Serve the page to this machine alone, with buttons that run check, identify and"
        " diagnose; Ctrl-C ends it."
    ),
    "export.params": _argument("A parameter file, .toml.", "PARAMS"),
    "export.to": _option(
        "mujoco, isaaclab, jsbsim or ardupilot.", "SIMULATOR", completing(_simulators)
    ),
    "export.log": _option(
        "Logs to fit and judge on; default: a standard excitation.", "DESCRIPTION"
    ),
    "export.time_step": _option("Of the simulator; default: its own.", "TIME"),
    "export.out": _file("Write the lines; default: print them."),
    "figures.at": _option(
        "Input at the working point; may be repeated. Default: at rest.",
        "INPUT=VALUE",
        complete_input,
    ),
    "figures.amplitude": _option(
        "Size of the command, as input or as output; default a tenth of the standard step.", "VALUE"
    ),
    "figures.frequency": _option(
        "Frequency at which gain and phase lag are told; may be repeated.", "VALUE"
    ),
    "figures.out": _file("Write figures and A, B, C, D: .json, .mat or .npz."),
    "figures.plot": _file("Draw step, gain, phase, poles and zeros to .svg, .png or .pdf."),
    "figures.beside": _file("Draw a parameter file beside it (.toml); may be repeated."),
    "identify.free": _option(
        "Parameters to estimate, or effects; default: 'free' of the description, else all with an"
        " uncertainty.",
        "NAME,NAME",
    ),
    "identify.search": _option("local (least squares) or global (CMA-ES, then least squares)."),
    "identify.starts": _option("Local searches from different starts.", min=1),
    "import.file": _argument(
        "An MJCF, an Isaac Lab configuration, a JSBSim file, a .parm or BAM's JSON.",
        "FILE[#JOINT]",
    ),
    "import.inertia": _option("That the joint carries beside its armature.", "INERTIA"),
    "import.out": _file("Write a parameter file, .toml; default: show it."),
    "new.thing": _argument("What to begin."),
    "new.file": _argument("Python file of the actuator, or TOML file of the example.", "FILE"),
    "rehearse.noise": _option(
        "Standard deviation of an output, such as angle=0.1deg; may be repeated.", "NAME=VALUE"
    ),
    "rehearse.gap": _option("Gap to be made [noise floors]; may be repeated; default 3 and 10."),
    "rehearse.effects": _option("Effects to try; default: all that are off.", "A,B"),
    "rehearse.time_limit": _time("For each diagnosis, such as 60s."),
    "sample.params": _argument("Parameter file of identify or diagnose.", "PARAMS.toml"),
    "sample.count": _option("Number of sets.", min=1),
    "sample.out": _file(
        "Write the sets in SI: .csv, .json (FMU start values), .ssv (SSP, one a set)."
    ),
    "simulate.step": _option(
        "Step of an input at time 0; may be repeated. Default: the standard step.",
        "INPUT=VALUE",
        complete_input,
    ),
    "simulate.inputs": _file(
        "Inputs over time instead: any file that 'check' reads, with a column 'time' and"
        " columns such as 'voltage' or 'pulse_width \\[us]'; its rows are the communication"
        " points."
    ),
    "simulate.stop": _option("End of a step's run.", "TIME"),
    "simulate.dt": _option("Communication step.", "TIME"),
    "simulate.out": _file("Write all signals to .csv or .parquet."),
    "simulate.plot": _file("Draw all signals to .svg, .png or .pdf."),
    "survey.path": _argument(
        "A robot's recording, a folder of descriptions or logs, or a table of logs (.csv)."
    ),
    "survey.out": _file("Folder for what is found; default: beside the path, _survey."),
    "survey.actuator": MADE_BY,
    "survey.before": _file("Folder of an earlier survey: what is new, worse, better?"),
    "survey.scheduler": _option("A Dask scheduler whose workers do the work.", "ADDRESS"),
    "survey.quick": _option("Stop each at the first answer: effects one at a time."),
    "survey.time_limit": _time("For each joint, such as 60s."),
    "survey.reports": _option("Write a page for each joint.", names="--reports/--no-reports"),
    "validate.fmus": _argument("FMUs to validate; default: all actuators.", "[FMU]..."),
    "validate.params": _file("Parameter file, .toml: validate its FMU as well."),
    "validate.actuator": _file("Python file of your own actuator, for its FMU files."),
    "validate.timeout": _option("Longest run of an FMU for one case.", "SECONDS", min=0.1),
    "validate.memory": _option("Most memory of an FMU's process.", "MB", min=64.0),
    "validate.unpacked": _option("Most that an FMU may unpack to.", "MB", min=1.0),
    "validate.inputs": _file("Inputs of any FMU, CSV: time and columns."),
    "validate.reference": _file("What its outputs must be, CSV: time and columns."),
    "validate.tolerance": _file("Tolerances by output, .toml."),
    "validate.step": _time(
        "Communication step, such as '1 ms'; default: the points of the reference."
    ),
    "validate.cross_check": _option(
        "Take <model>_in.csv, _ref.csv and _ref.opt from it.", "FOLDER"
    ),
    "validate.write_cross_check": _option(
        "Write these files, and <model>_out.csv, to it.", "FOLDER"
    ),
    "validate.static_only": _option("Look at the files of any FMU; load and run nothing."),
    "validate.junit": _file("Write the result as JUnit XML."),
    "validate.summary": _file("Append the verdict in Markdown, as to $GITHUB_STEP_SUMMARY."),
    "validate.every": _option("Print every figure, not one a case.", names="--all"),
    "validate.brief": _option("Print the verdict and what failed; name each job as it begins."),
}
"""What each argument or option is: in all commands, or in one."""


def described(name: str, command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command whose parameters are arguments and options, as the table has them."""
    for parameter, hint in get_type_hints(command).items():
        if parameter != "return":
            about = copy(WORDS.get(f"{name}.{parameter}") or WORDS[parameter])
            if isinstance(about, OptionInfo) and about.default is ...:
                about.default = f"--{parameter.strip('_').replace('_', '-')}"
            command.__annotations__[parameter] = Annotated[hint, about]
    return command
