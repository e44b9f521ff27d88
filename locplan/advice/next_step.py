"""The next step after a check: a sentence, commands, and files."""

from __future__ import annotations

import shlex
from pathlib import Path as Folder
from typing import NamedTuple

from locplan._support.intervals import format_metres
from locplan._support.runs import get_command_line
from locplan.advice.check_result import Check
from locplan.advice.files import Params, has_amcl_section, list_parameter_files
from locplan.advice.fixes import (
    CHEAP,
    CORRECTED_MAP,
    FULL_RANGE,
    LANDMARKS,
    PATHS,
    REPAIRED_MAP,
    SETTINGS,
)
from locplan.advice.rates import is_better, is_loss_rate_low

HALF = 0.5
"""Share of lost drives that is still a failure."""


class NextAction(NamedTuple):
    """The next step: a sentence, commands, and files."""

    sentence: str
    """The instruction."""
    command: str
    """Commands to copy, a line each; empty without one."""
    files: dict[str, str]
    """Purpose of each file that the step needs, by its name."""


def choose_next_action(
    check: Check, folder: Folder | None = None, params: Params = (), *_: object
) -> NextAction:
    """Return the next step after a check.

    Parameters
    ----------
    check : Check
        The check.
    folder : path, optional
        The folder that its files are in.
    params : path or sequence of path, default ()
        The user's Nav2 parameters. Without an amcl section, the check writes only that section.
    """
    if check.is_fine:
        return NextAction(_describe_no_action(check), "", {})
    map_file = str(Folder(check.source.file).resolve()) if check.source else "MAP"
    repeat_command = get_command_line() or ["locplan", "check", map_file]
    save_words = ["-o", str(folder or "report")]
    if check.recommended and folder is None:
        titles = " and ".join(fix.title for fix in check.recommended_fixes)
        command = shlex.join([*repeat_command, *save_words])
        return NextAction(
            f"write the files for {titles}:", command, check.describe_fix_files(params)
        )
    if check.recommended and folder:
        commands = _make_commands(check, folder, repeat_command, map_file, params)
        doing = " and ".join(_list_instructions(check, folder, params))
        then = ", then check again" if "locplan check" in commands else ""
        return NextAction(f"{doing}{then}:", commands, check.describe_fix_files(params))
    if check.passage:
        return NextAction(*_advise_footprint_correction(check, repeat_command, save_words), {})
    return NextAction(*_advise_without_better_fix(check, repeat_command, save_words, map_file), {})


def describe_remaining_failures(check: Check) -> str:
    """Return the sentence on failures that remain with the fixes; empty if none remain."""
    if not check.recommended:
        return ""
    if not any(map(is_better, check.recommended_fixes)):
        if CORRECTED_MAP in check.recommended:
            return "The map file is wrong, but simulated drives are not better with the correction."
        return "The settings help on the recording, but not in simulated drives."
    if is_loss_rate_low(check.after.lost):
        return ""
    share = "Most" if check.after.lost.value >= HALF else "Some"
    get_lost = "still get lost" if check.before.lost.value > 0 else "get lost with the fix"
    further = " With --effort usual, check also tries other paths and poles."
    return f"{share} drives {get_lost}.{further if check.effort == 'quick' else ''}"


def _describe_no_action(check: Check) -> str:
    """Return the sentences for a robot that rarely fails."""
    rare = ": failures are rare, and no fix helps" if check.baseline.has_failure else ""
    sentences = [f"Nothing to do{rare}."]
    cheap = [fix for fix in check.fixes if is_better(fix) and fix.kind in CHEAP]
    if cheap:
        now, then = (format_metres(r.error.value) for r in (check.baseline, cheap[0].rates))
        detail = f" ({cheap[0].detail})" if cheap[0].kind == SETTINGS else ""
        title = f"{cheap[0].title[:1].upper()}{cheap[0].title[1:]}"
        sentences.append(f"{title}{detail} would lower the error from {now} to {then}.")
    if check.effort == "quick":
        max_loss = 100 * check.baseline.lost.high
        sentences.append(f"A quick check cannot exclude a loss rate of up to {max_loss:.0f} %.")
    return " ".join(sentences)


def _list_instructions(check: Check, folder: Folder, params: Params) -> list[str]:
    """Return the instructions of the recommended fixes; two fixes may share a file."""
    titles = [fix.title for fix in check.recommended_fixes if fix.kind in {FULL_RANGE, SETTINGS}]
    file = f"{folder / 'nav2_params.yaml'} ({', '.join(titles)})"
    parameters = f"copy the amcl section of {file} into your parameters"
    if titles and has_amcl_section(list_parameter_files(params)):
        parameters = f"start Nav2 with {file}"
    texts = {
        CORRECTED_MAP: f"use {folder / 'map.yaml'} as the map",
        REPAIRED_MAP: "give AMCL the repaired map (the line in amcl.yaml)",
        FULL_RANGE: parameters,
        SETTINGS: parameters,
    }
    for fix in check.recommended_fixes:
        if fix.kind == PATHS:
            texts[PATHS] = f"give Nav2 the {fix.title}"
        if fix.kind == LANDMARKS:
            texts[LANDMARKS] = f"put up {fix.title} at the places in {folder / 'landmarks.csv'}"
    return [*dict.fromkeys(texts[fix.kind] for fix in check.recommended_fixes)]


def _advise_footprint_correction(
    check: Check, repeat_command: list[str], save_words: list[str]
) -> tuple[str, str]:
    """Return instruction and command if drives fail even with perfect localization."""
    passage, robot = check.passage, check.scenario.robot
    widen = "widen the passage, or " if passage and passage.is_narrow else ""
    if robot.outline is not None:
        sentence = f"{widen}correct the outline in the robot's file, then check again:"
        return sentence, shlex.join([*repeat_command, *save_words])
    command = [word for word in repeat_command if not word.startswith("--set=footprint=")]
    return (
        f"{widen}correct the robot's radius (now {robot.footprint:g} m), then check again:",
        shlex.join([*command, f"--set=footprint={robot.footprint:g}", *save_words]),
    )


def _advise_without_better_fix(
    check: Check, repeat_command: list[str], save_words: list[str], map_file: str
) -> tuple[str, str]:
    """Return instruction and command if no fix is better."""
    if check.effort == "quick":
        command = [word for word in repeat_command if word != "--effort=quick"]
        return (
            "no fix helps so far. Try other paths and poles with three times as many drives:",
            shlex.join([*command, *save_words]),
        )
    if check.recording_sentences:
        drive = [
            word.partition("=")[2] for word in repeat_command if word.startswith("--recording=")
        ]
        command = ["locplan", "recording", *drive[:1], map_file, "-o", "recording"]
        return "no fix helps. See where the scans do not fit the map:", shlex.join(command)
    return (
        "no fix helps. Record a drive on the site, and check again with it:",
        "ros2 bag record -o drive /scan /odom /tf /tf_static",
    )


def _make_commands(
    check: Check, folder: Folder, repeat_command: list[str], map_file: str, params: Params
) -> str:
    """Return the commands that apply the fixes or check them again, a line each."""
    kinds, absolute_folder = {*check.recommended}, folder.resolve()
    lines = []
    mask, params = bool(check.artifacts.get(PATHS)), list_parameter_files(params)
    # The map servers come before Nav2, which waits for its maps.
    for place, is_needed in (
        (absolute_folder, REPAIRED_MAP in kinds),
        (absolute_folder / "mask", mask),
    ):
        if is_needed:
            lines.append(["ros2", "launch", str(place / "localizability.launch.xml")])
    if {CORRECTED_MAP, LANDMARKS} & kinds:
        name = "map_with_landmarks.yaml" if LANDMARKS in kinds else "map.yaml"
        map_file = str(absolute_folder / name)
    arguments = [f"map:={map_file}"]
    settings = {FULL_RANGE, SETTINGS} & kinds and has_amcl_section(params)
    changed = str(absolute_folder / "nav2_params.yaml") if settings else ""
    if mask and params:  # which has the other changes, too
        parameter_name = "nav2.yaml" if changed or len(params) == 1 else "merged.yaml"
        changed = str(absolute_folder / "mask" / parameter_name)
    if changed:
        arguments.append(f"params_file:={changed}")
    if len(arguments) > 1 or {CORRECTED_MAP, LANDMARKS} & kinds:
        lines.append(["ros2", "launch", "nav2_bringup", "bringup_launch.py", *arguments])
    if PATHS in kinds and not mask:
        paths = [f"--path={absolute_folder / name}" for name in check.changed_paths]
        to = ["--to", "nav2-routes", *paths, "-o", str(absolute_folder / "routes")]
        lines.append(["locplan", "export", map_file, *to])
    if len(arguments) == 1 and not {CORRECTED_MAP, LANDMARKS, PATHS} & kinds:
        # The user copies the lines of these files by hand, and can check them before.
        repeat_command = [
            word
            for word in repeat_command
            if REPAIRED_MAP not in kinds or "--filter-map" not in word
        ]
        file_options = {
            REPAIRED_MAP: ("--filter-map", "map_amcl.yaml"),
            SETTINGS: ("--robot", "nav2_params.yaml"),
        }
        for fix, (option, name) in file_options.items():
            if fix in kinds or (fix == SETTINGS and FULL_RANGE in kinds):
                repeat_command += [option, str(folder / name)]
        lines.append(repeat_command)
    return "\n".join(map(shlex.join, lines))
