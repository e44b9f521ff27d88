import dataclasses
import inspect

import pytest

from locplan.export import nav2_keepout, nav2_routes, nav2_speed
from locplan.export.formats import FORMATS
from locplan.export.plain_files import write_path_file
from locplan.export.user_graph import nav2_graph


@pytest.mark.parametrize(
    ("name", "function"),
    [
        ("nav2-keepout", nav2_keepout),
        ("nav2-speed", nav2_speed),
        ("nav2-routes", nav2_routes),
        ("nav2-routes", nav2_graph),
        ("path", write_path_file),
    ],
)
def test_format_has_defaults_of_function(name, function):
    """Command line and Python write the same files by default."""
    (options,) = (format.options for format in FORMATS if format.name == name)
    defaults = {field.name: field.default for field in dataclasses.fields(options)}
    parameters = inspect.signature(function).parameters
    optional = [name for name in defaults if name in parameters]
    shared = [name for name in optional if parameters[name].default is not inspect.Parameter.empty]
    assert len(shared) > 1
    for name in shared:
        assert (defaults[name] or None) == (parameters[name].default or None), name
