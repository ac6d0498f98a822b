"""All studies by name."""

from collections.abc import Mapping
from difflib import get_close_matches
from types import MappingProxyType

from fakes.studies.misfits import clean_sessions
from fakes.studies.misfits import study as misfits
from fakes.studies.movement import false_alarms, moved_camera, moved_links, moved_teaching
from fakes.studies.paper import (
    experiment_a,
    fig4,
    fig5,
    fig10,
    insertions,
    table3,
    table3_means,
    table4,
    tilt,
)
from fakes.studies.paper.contacts import contact_methods, contact_plans
from fakes.studies.paper.published import eq9, eq19, eq25
from fakes.studies.planning import expected
from fakes.studies.prints import single_tags
from fakes.studies.robustness import (
    bare_targets,
    blunders,
    cell_fit,
    certificate,
    coached,
    conventions,
    coverage,
    degenerate,
    degenerate_touches,
    jog_and_touch,
    modbus_robot,
    time_offset,
    wrong_touches,
)
from fakes.studies.study import Study
from vgrd.errors import InputError

STUDIES: Mapping[str, Study] = MappingProxyType(
    {
        module.STUDY.name: module.STUDY
        for module in (
            fig4,
            fig5,
            fig10,
            experiment_a,
            table3,
            table3_means,
            table4,
            insertions,
            tilt,
            contact_methods,
            contact_plans,
            eq9,
            eq19,
            eq25,
            certificate,
            cell_fit,
            clean_sessions,
            coverage,
            bare_targets,
            blunders,
            coached,
            conventions,
            degenerate,
            degenerate_touches,
            expected,
            false_alarms,
            jog_and_touch,
            misfits,
            modbus_robot,
            moved_camera,
            moved_links,
            moved_teaching,
            single_tags,
            time_offset,
            wrong_touches,
        )
    }
)


def study_called(name: str) -> Study:
    """Study of that name; InputError with the known names, the likely one first."""
    if name not in STUDIES:
        likely = get_close_matches(name, STUDIES, n=1)
        hint = f"; did you mean {likely[0]!r}?" if likely else "."
        raise InputError(f"there is no study {name!r}{hint} There are: {', '.join(STUDIES)}")
    return STUDIES[name]
