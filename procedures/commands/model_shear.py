"""The command palpate model shear."""

from __future__ import annotations

import click

from palpate.procedures.commands.options import Output, StrictCommand, option, output_options


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate model shear\n\n  palpate model shear --design different_base --sample 2 --json",
)
@option("--design", default="common_base", help="single, common_base or different_base.")
@option("--sample", default="1", help="Rubber sample on the sensor.")
@output_options
def shear(design: str, sample: str, as_json: bool, quiet: bool) -> None:
    """Compute the effect of a shear force on each film, and the off-centre load with the same effect.

    The force acts along the line of the teeth, once on the top of the first tooth and once on the object's upper side.
    The solid model computes it, with the object bonded. The change is the difference from the next coarser mesh.
    """
    from palpate.instrument.models import shear as model
    from palpate.instrument.notice import price
    from palpate.instrument.sensor.designs import get_design
    from palpate.instrument.sensor.sample import get_sample

    sensor, sensed, output = get_design(design), get_sample(sample), Output(as_json, quiet)
    meshes: list[dict[str, model.FilmShear]] = []
    with output.prices(), output.progress("solving") as progress:
        for refinement in model.MESHES:
            if meshes:  # the coarse one refuses what has no answer, and takes a tenth of the time
                price(f"solving the finer mesh of {sensor.name}", model.SECONDS)
            meshes.append(model.shear(sensor, sensed, refinement))
            progress(len(meshes), len(model.MESHES), f"mesh {refinement}")
    coarse, films = meshes
    if output.as_json:
        found = [{"film": name, **film.summary(coarse[name])} for name, film in films.items()]
        output.json({"design": design, "sample": sample, "films": found, "told": model.shear_pattern(films)})
    elif output.for_people:
        from palpate.procedures.showing.shear import print_shear

        print_shear(f"{design}, sample {sample}", films, coarse)
