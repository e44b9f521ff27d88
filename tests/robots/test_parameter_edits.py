"""Parameter files of Nav2 in which single values are changed."""

import pytest

from locplan.errors import LocplanError
from locplan.robots import read_parameters
from locplan.robots.parameter_edits import edit_parameters

VALUES = {"alpha1": 0.05, "max_beams": 120, "laser_model_type": "likelihood_field_prob"}


def edited(folder, text: str, values=VALUES, robot: str = "") -> str:
    """The file with other values, which is read back to have them."""
    file = folder / "params.yaml"
    file.write_bytes(text.encode())
    made = edit_parameters(f"{file}{robot}", "amcl", values)
    assert file.read_bytes() == text.encode()
    before = read_parameters(f"{file}{robot}")
    file.write_bytes(made)
    assert (
        read_parameters(f"{file}{robot}").read_node_parameters("amcl")
        == before.read_node_parameters("amcl") | values
    )
    return made.decode()


def test_edit_replaces_values_in_place(tmp_path):
    text = """# my robot
map_server:
  ros__parameters: {yaml_filename: "lab.yaml"}   # not this one
amcl:
  ros__parameters:  # AMCL
    alpha1: 0.2       # set long ago
    alpha2: 0.2
    laser_model_type: "likelihood_field"
    max_beams: 60
"""
    new = text.replace("alpha1: 0.2  ", "alpha1: 0.05  ").replace("60", "120")
    assert edited(tmp_path, text) == new.replace('field"', 'field_prob"')


def test_edit_inserts_missing_values_at_top(tmp_path):
    text = "amcl:\n    ros__parameters:\n        # AMCL\n        alpha1: .2 # was\n"
    assert edited(tmp_path, text) == (
        "amcl:\n    ros__parameters:\n        # AMCL\n        max_beams: 120\n"
        "        laser_model_type: likelihood_field_prob\n        alpha1: 0.05 # was\n"
    )


def test_edit_keeps_line_ends_and_bom(tmp_path):
    text = "\ufeffamcl:\r\n  ros__parameters:\r\n    alpha1: 0.2\r\n    z_hit: 0.5"
    made = edited(tmp_path, text)
    assert made.startswith("\ufeff")
    assert made.count("\r\n") == made.count("\n") == 5
    assert made.endswith("z_hit: 0.5")


@pytest.mark.parametrize(
    ("text", "new"),
    [
        (
            "amcl: {ros__parameters: {alpha1: 0.2}}\n",
            "amcl: {ros__parameters: {max_beams: 120, laser_model_type: likelihood_field_prob,"
            " alpha1: 0.05}}\n",
        ),
        (
            "amcl: {ros__parameters: {}}",
            "amcl: {ros__parameters: {alpha1: 0.05, max_beams: 120,"
            " laser_model_type: likelihood_field_prob}}",
        ),
        (
            'amcl: {"ros__parameters": {\'max_beams\':60,"alpha1":0.2,\n'
            " laser_model_type: 'likelihood_field'}}",
            'amcl: {"ros__parameters": {\'max_beams\':120,"alpha1":0.05,\n'
            " laser_model_type: 'likelihood_field_prob'}}",
        ),
    ],
)
def test_mappings_in_braces_are_changed(tmp_path, text, new):
    assert edited(tmp_path, text) == new


def test_edit_changes_last_of_duplicate_keys(tmp_path):
    text = "amcl: {ros__parameters: {alpha1: 0.1, alpha1: 0.3}}"
    assert "alpha1: 0.1, alpha1: 0.05" in edited(tmp_path, text)


def test_merged_values_are_overruled(tmp_path):
    text = "shared: &s {alpha1: 0.3}\namcl:\n  ros__parameters:\n    <<: *s\n    max_beams: 30\n"
    made = edited(tmp_path, text)
    assert made.startswith("shared: &s {alpha1: 0.3}\n")
    assert "    alpha1: 0.05\n" in made


def test_edit_replaces_alias_by_value(tmp_path):
    text = "amcl:\n  ros__parameters:\n    z_hit: &h 0.5\n    alpha1: *h\n"
    assert edited(tmp_path, text, {"alpha1": 0.05}) == text.replace("*h", "0.05")


@pytest.mark.parametrize(
    "text",
    [
        "amcl:\n  ros__parameters:\n    alpha1: &a 0.2\n    alpha2: *a\n",
        "other: &o {ros__parameters: {alpha1: 0.1}}\namcl: *o\n",
        "other: &o {ros__parameters: {alpha1: 0.1, z: 1}}\namcl: {<<: *o}\n",
        "amcl:\n  ros__parameters:\n    alpha1: 0.2\n    laser_model_type: |\n      a\n    z: 1\n",
    ],
)
def test_edit_refuses_shared_or_multiline_values(tmp_path, text):
    """The edit would change other lines as well."""
    (tmp_path / "params.yaml").write_text(text)
    with pytest.raises(LocplanError, match="anchors and aliases") as caught:
        edit_parameters(tmp_path / "params.yaml", "amcl", VALUES)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.05, "0.05"),
        (60, "60"),
        (1e-5, "1.0e-05"),
        (1e20, "1.0e+20"),
        (True, "true"),
        ("a", "a"),
    ],
)
def test_edit_writes_values_ros_can_read(tmp_path, value, text):
    (tmp_path / "params.yaml").write_text("amcl:\n  ros__parameters:\n    alpha1: 0.2\n")
    made = edit_parameters(tmp_path / "params.yaml", "amcl", {"alpha1": value})
    assert made.decode().splitlines()[-1] == f"    alpha1: {text}"
