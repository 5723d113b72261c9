"""servo-models explain"""

from __future__ import annotations

from pathlib import Path

from servo_models.errors import UserError


def explain(
    name: str | None = None,
    variant: str | None = None,
    params: Path | None = None,
    trust: bool = False,
    picture: Path | None = None,
    diagram: Path | None = None,
    page: Path | None = None,
) -> None:
    """Explain an actuator, an effect or a parameter file.

    Equations, parameters, sources, a picture; of a file its values, their origin and what
    the fit reached.

    Examples:

    servo-models explain torque_motor

    servo-models explain sg90 --variant printed

    servo-models explain sg90 --diagram sg90.svg

    servo-models explain backlash --picture backlash.svg

    servo-models explain backlash --page backlash.html

    servo-models explain --params identified.toml
    """
    from servo_models.analysis.explain import explain as sheet_of
    from servo_models.analysis.explain import is_actuator
    from servo_models.cli.console import progress, show
    from servo_models.data.parameters import read_parameters
    from servo_models.data.sections import parameter_report

    if params:
        if name or variant or picture or diagram or page:
            raise UserError(
                "--params is explained alone: leave out the name, --variant, --picture, --diagram"
                " and --page"
            )
        show(parameter_report(read_parameters(params, trust)))
        return
    if not name:
        raise UserError("nothing to explain: name an actuator or an effect, see 'list'")
    if name.endswith(".toml"):
        raise UserError(f"'{name}' is a file: explain a parameter file with --params {name}")
    if diagram and not is_actuator(name):
        raise UserError(f"'{name}' is no actuator: only these have a block diagram")
    show(sheet_of(name, variant))
    if page:
        from servo_models.analysis.live import explained
        from servo_models.files import write_whole
        from servo_models.report.html import page as html

        with progress(f"writing {page}"):
            write_whole(page, html(explained(name, variant)).encode())
        print(f"wrote '{page}'")
    if picture:
        from servo_models.analysis.demonstration import portrait
        from servo_models.analysis.pictures import check_suffix, save

        check_suffix(picture)
        with progress(f"drawing {name}"):
            save(portrait(name, variant), picture)
    if diagram:
        from servo_models.analysis.diagram import diagram as drawn_from
        from servo_models.analysis.pictures import check_suffix, save
        from servo_models.catalogue import actuator
        from servo_models.report.style import figure

        check_suffix(diagram)
        with progress(f"drawing {name}"):
            save(figure(drawn_from(actuator(name), variant)), diagram)
