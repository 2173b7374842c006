"""`robosim slam --team`: one map of several logs."""

from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import Any

from rich.table import Table

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import results_folder
from robosim.logs.log_mapping import LogConfig, make_plan
from robosim.logs.robot_log import RobotLog
from robosim.logs.team_mapping import Session, map_team
from robosim.logs.trajectory_scores import compare_trajectories
from robosim.support.files import write_json
from robosim.support.progress import stages_tracked
from robosim.support.tum import write_tum

#: Equal wings of a building, joined wrongly, agree in at most this part of their surfaces.
_EQUAL_WINGS = 0.95


def join_logs(logs: Sequence[RobotLog], how: LogConfig, out: Path | None) -> None:
    """Map logs in one frame, and write the map and a trajectory for each; maps that lie apart in folders of their own.

    Raises:
        ValueError: If there are less than two logs.
    """
    if len(logs) < 2:
        raise ValueError("--team joins the maps of several logs: give two or more, or leave --team away.")
    table = Table(
        "map", "log", "scans", "x [m]", "y [m]", "yaw [deg]", "loops with others", "ATE [m]", "RPE [m]"
    )
    results: list[dict[str, Any]] = []
    with results_folder(out, "slam") as folder:
        maps = map_team(logs, how, stages_tracked("team", console))
        for number, sessions in enumerate(maps):
            place = folder / sessions[0].log.name if number else folder
            rows = [_row(session) for session in sorted(sessions, key=lambda session: session.number)]
            for row in rows:
                _add(table, "." if place == folder else place.name, row)
            _write(place, sessions, how)
            agreement = sessions[0].agreement
            result = {"folder": str(place.relative_to(folder)), "logs": rows, "agreement": agreement}
            write_json(place / "result.json", result)
            results.append(result)
    emit_result({"maps": results}, folder)
    console.print(table)
    for sessions in maps:
        if len(sessions) > 1:
            console.print(_how_sure(sessions), soft_wrap=True)
    for sessions in maps[1:]:
        names = ", ".join(session.log.name for session in sessions)
        console.print(
            f"{names}: not placed relative to {maps[0][0].log.name}; too few places that both saw can be recognised "
            f"without doubt. Its map lies apart, in {folder / sessions[0].log.name}",
            soft_wrap=True,
        )
    console.print(
        f"Wrote map.yaml, map.png, result.json and a trajectory for each log in {folder}", soft_wrap=True
    )
    console.print(f"Next: robosim plan {quote(str(folder / 'map.yaml'))}", soft_wrap=True)


def _how_sure(sessions: Sequence[Session]) -> str:
    """Line on a joined map."""
    names, agreement = ", ".join(session.log.name for session in sessions), sessions[0].agreement
    line = f"{names}: surfaces that several of them saw agree in {100 * agreement:.0f} %."
    if agreement > _EQUAL_WINGS:
        return line
    return f"{line} Equal wings or storeys of a building can agree as well: check map.png."


def _write(folder: Path, sessions: Sequence[Session], how: LogConfig) -> None:
    """Map of sessions as a plan and as a picture, and their trajectories."""
    from robosim.drawing.plots import draw_team
    from robosim.plans.files import write_ros

    sessions = sorted(sessions, key=lambda session: session.number)
    runs = [(session.log, session.poses) for session in sessions]
    plan = make_plan(runs, sessions[0].log.name, how.resolution_m, how.range_m)
    for session in sessions:
        write_tum(folder / f"{session.log.name}.tum", session.log.times, session.poses)
    write_ros(plan, folder / "map.yaml")
    title = f"{plan.name}: map of one log" if len(sessions) == 1 else f"Map of {len(sessions)} logs"
    draw_team(folder / "map.png", plan, {session.log.name: session.poses for session in sessions}, title)


def _row(session: Session) -> dict[str, Any]:
    """Start of a session in the frame of its map, number of loops, and errors against its own reference."""
    log = session.log
    row: dict[str, Any] = {
        "log": log.name,
        "scans": len(log.times),
        "start": session.poses[0],
        "start_covariance": session.start_covariance,
        "loops_across": session.loops_across,
    }
    return row if log.reference is None else row | compare_trajectories(session.poses, log.reference)


def _add(table: Table, place: str, row: dict[str, Any]) -> None:
    x, y, yaw = row["start"]
    errors = [f"{row[key]:.3f}" if key in row else "" for key in ("ate_m", "rpe_m")]
    pose = f"{x:.2f}", f"{y:.2f}", f"{57.29578 * yaw:.1f}"
    table.add_row(place, row["log"], str(row["scans"]), *pose, str(row["loops_across"]), *errors)
