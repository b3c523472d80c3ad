"""Sessions of earlier versions open: what were settings there and are constants now is left out."""

from __future__ import annotations

import pytest
import tomli_w
from msgspec import structs

from tests.made_runs import finished
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.run.former_settings import FORMER
from verefine_viz.run.run_header import session_of
from verefine_viz.run.session_file import parsed_toml, session_toml


def test_a_former_setting_is_left_out_where_it_has_the_constant_and_refused_where_not() -> None:
    header = structs.replace(finished("1/1", ()).header, session=session_toml(Session()))
    with_former = parsed_toml(header.session)
    for section, fields in FORMER.items():
        with_former[section] |= fields
    old = structs.replace(header, session=tomli_w.dumps(with_former))
    assert session_of(old) == session_of(header)
    with_former["pcs"]["quads"] = 500
    with pytest.raises(SettingsError, match="quads"):
        session_of(structs.replace(header, session=tomli_w.dumps(with_former)))
