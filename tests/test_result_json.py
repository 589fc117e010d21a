import json
import math
from dataclasses import replace

import numpy as np
import pytest

from linear_ik.element import Element, Placement
from linear_ik.exports.result_json import result_to_json, result_to_mapping, with_short_history, write_result
from linear_ik.profile import IShape
from linear_ik.readers.result_json import SCHEMA, ResultError, read_result, result_from_mapping
from linear_ik.result import FitResult, IterationRecord, SegmentResult
from linear_ik.settings import FitSettings

N = 4
CONTRACT = {
    "schema": str,
    "status": str,
    "reasons": list,
    "reason_codes": list,
    "iterations": int,
    "nodes_m": list,
    "nodes_covariance_m2": list,
    "joint_angles_rad": list,
    "joint_limits_rad": list,
    "base_pose": list,
    "rmse_m": float,
    "surface_rmse_m": float,
    "segments": list,
    "history": list,
    "settings": dict,
    "timings_s": dict,
    "versions": dict,
}


def make_result(status="uncertain", segments=N, location=(512345.678, 5403210.123, 412.5)):
    """A result whose every number is an awkward double, as a fit's are."""
    random = np.random.default_rng(7)
    element = Element(
        "Stütze 7",
        IShape(0.2, 0.2, 0.009, 0.015, 0.018),
        3.0,
        segments,
        Placement(location),
        joint_limit_deg=(30, 40, 50),
    )
    q = random.normal(size=3 * segments) / 30
    root = random.normal(size=(segments + 1, 3, 3)) * 1e-4
    covariance = root @ root.transpose(0, 2, 1)
    base = element.placement.T_world_element
    history = tuple(
        IterationRecord(
            i + 1, "full", 900 + i, 0.002 / (i + 1), math.inf if i == 0 else 0.005, 1e-6, 0.1, q * i / 3, base
        )
        for i in range(3)
    )
    parts = [SegmentResult("measured", 100, 0.5, 0.001) for _ in range(segments - 1)]
    limits = np.stack(
        [-np.tile(element.joint_limit_rad, (segments, 1)), np.tile(element.joint_limit_rad, (segments, 1))], -1
    )
    return FitResult(
        element=element,
        status=status,
        reasons=("Segment 4 has no points.",),
        reason_codes=("segments_not_scanned",),
        nodes_m=np.array(location) + random.normal(size=(segments + 1, 3)),
        nodes_covariance_m2=covariance,
        q=q,
        joint_angles_rad=q.reshape(-1, 3)[:, ::-1],
        joint_limits_rad=limits,
        base_pose=base,
        rmse_m=1 / 130,
        surface_rmse_m=1 / 990,
        range_noise_m=1 / 1010,
        segments=(*parts, SegmentResult("not_scanned", 0, 0.0, math.nan)),
        history=history,
        settings=FitSettings(search="always", range_noise_m=0.002),
        timings_s={"coarse": 0.01, "total": 0.1},
    )


def test_contract_keys_and_types():
    mapping = json.loads(result_to_json(make_result()))
    assert mapping["schema"] == SCHEMA == "linear_ik/result/1"
    for key, kind in CONTRACT.items():
        assert isinstance(mapping[key], kind), key
    assert np.shape(mapping["nodes_m"]) == (N + 1, 3)
    assert np.shape(mapping["nodes_covariance_m2"]) == (N + 1, 3, 3)
    assert np.shape(mapping["joint_angles_rad"]) == (N, 3)
    assert np.shape(mapping["joint_limits_rad"]) == (N, 3, 2)
    assert np.shape(mapping["base_pose"]) == (4, 4)
    assert mapping["iterations"] == len(mapping["history"]) == 3
    assert [record["iteration"] for record in mapping["history"]] == [1, 2, 3]
    assert set(mapping["segments"][0]) == {"status", "points", "coverage", "surface_rmse_m"}
    assert mapping["settings"]["search"] == "always"
    assert {"linear_ik", "numpy", "pin", "osqp", "python"} <= set(mapping["versions"])


def test_unknown_numbers_are_null_not_nan():
    text = result_to_json(make_result())
    assert "NaN" not in text and "Infinity" not in text
    mapping = json.loads(text)
    assert mapping["segments"][-1]["surface_rmse_m"] is None
    assert mapping["history"][0]["scale_m"] is None
    assert mapping["history"][1]["scale_m"] == 0.005


@pytest.mark.parametrize("status", ["converged", "not_scanned"])
def test_round_trip_is_exact(tmp_path, status):
    result = make_result(status)
    path = write_result(result, tmp_path / "new" / "result.json")
    back = read_result(path)
    for name in ("nodes_m", "nodes_covariance_m2", "q", "joint_angles_rad", "joint_limits_rad", "base_pose"):
        assert np.array_equal(getattr(back, name), getattr(result, name)), name
        assert getattr(back, name).dtype == np.float64
    for name in (
        "element",
        "status",
        "reasons",
        "reason_codes",
        "rmse_m",
        "surface_rmse_m",
        "range_noise_m",
        "settings",
        "timings_s",
    ):
        assert getattr(back, name) == getattr(result, name), name
    assert back.segments[:-1] == result.segments[:-1]
    assert math.isnan(back.segments[-1].surface_rmse_m)
    assert back.history[0].scale_m == math.inf
    for one, other in zip(back.history, result.history, strict=True):
        assert np.array_equal(one.q, other.q) and np.array_equal(one.base_pose, other.base_pose)
        assert (one.iteration, one.phase, one.points, one.surface_rmse_m) == (
            other.iteration,
            other.phase,
            other.points,
            other.surface_rmse_m,
        )
    # What is read can be written again, to the last bit.
    assert result_to_json(back) == result_to_json(result)


def test_a_result_written_before_there_were_codes_is_read_without():
    mapping = result_to_mapping(make_result())
    del mapping["reason_codes"]
    back = result_from_mapping(mapping)
    assert back.reasons and back.reason_codes == () and not back.doubts_are_carried


def test_covariance_that_is_not_known_comes_back_as_nan(tmp_path):
    mapping = result_to_mapping(make_result())
    mapping["nodes_covariance_m2"] = [[[None] * 3] * 3] * (N + 1)
    mapping["rmse_m"] = None
    back = result_from_mapping(mapping)
    assert np.isnan(back.nodes_covariance_m2).all()
    assert math.isnan(back.rmse_m)


def _without(key):
    def edit(mapping):
        del mapping[key]

    return edit


def _set(*path_and_value):
    *path, last, value = path_and_value

    def edit(mapping):
        for step in path:
            mapping = mapping[step]
        mapping[last] = value

    return edit


@pytest.mark.parametrize(
    "edit, said",
    [
        (_set("schema", "linear_ik/result/2"), "schema"),
        (_without("schema"), "schema"),
        *((_without(key), key) for key in CONTRACT if key not in ("schema", "versions", "iterations", "reason_codes")),
        (_without("element"), "element"),
        (_set("status", "good"), "status"),
        (_set("segments", 1, "status", "seen"), "segments[1].status"),
        (_set("segments", []), "segments"),
        (_set("segments", 0, None), "segments[0]"),
        (_set("segments", 0, "points", "many"), "segments[0].points"),
        (_set("nodes_m", [[0, 0, 0]]), "nodes_m"),
        (_set("nodes_m", 0, ["a", "b", "c"]), "nodes_m"),
        (_set("nodes_m", 0, [0, 0]), "nodes_m"),
        (_set("q", None), "q"),
        (_set("rmse_m", "small"), "rmse_m"),
        (_set("reasons", "none"), "reasons"),
        (_set("reason_codes", ["segments_not_scanned"] * 2), "reason_codes"),
        (_set("history", 0, "q", [1.0]), "history[0].q"),
        (_set("history", 0, "phase", 3), "history[0].phase"),
        (_set("history", {}), "history"),
        (_set("settings", "search", "sometimes"), "search"),
        (_set("settings", []), "settings"),
        (_set("nodes_m", 0, ["1", "2", "3"]), "nodes_m"),
        (_set("nodes_m", 0, [True, 0, 0]), "nodes_m"),
        (_set("nodes_m", 0, [None, 0, 0]), "nodes_m"),
        (_set("nodes_covariance_m2", 0, 0, 0, "1e-6"), "nodes_covariance_m2"),
        (_set("base_pose", 3, 3, True), "base_pose"),
        (_set("q", 0, 10**400), "q"),
        (_set("reasons", 0, {"said": "much"}), "reasons[0]"),
        (_set("reason_codes", 0, 7), "reason_codes[0]"),
        (_set("unobservable", [None]), "unobservable[0]"),
        (_set("iterations", 7), "iterations"),
        (_set("iterations", "3"), "iterations"),
        (lambda mapping: mapping["history"][1].pop("scale_m"), "history[1].scale_m"),
        (_set("history", 1, "scale_m", True), "history[1].scale_m"),
        (_set("history", 1, "q", 0, None), "history[1].q"),
        (_set("element", "length", -1), "length"),
        (_set("element", "profile", "type", "h_shape"), "profile.type"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, edit, said):
    mapping = json.loads(result_to_json(make_result()))
    edit(mapping)
    path = tmp_path / "result.json"
    path.write_text(json.dumps(mapping), encoding="utf-8")
    with pytest.raises(ResultError) as caught:
        read_result(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert said in caught.value.what
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[1, 2]", b"null", b"\xff\xfe\x00", b"[" * 100_000, b"1" * 5000])
def test_what_is_no_result_is_said_so(tmp_path, content):
    path = tmp_path / "result.json"
    path.write_bytes(content)
    with pytest.raises(ResultError, match="result"):
        read_result(path)


def test_missing_file_and_folder(tmp_path):
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(ResultError, match="cannot be read"):
            read_result(path)


def test_a_short_history_says_the_same_in_half_the_text():
    result = make_result()
    rng = np.random.default_rng(0)
    long = [
        replace(record, q=rng.normal(size=len(record.q)) * 0.1, step_rad=0.123456789 / i, iteration=i)
        for i, record in enumerate(list(result.history) * 40, 1)
    ]
    result = replace(result, history=tuple(long))
    short = with_short_history(result)
    assert [(r.iteration, r.phase, r.points) for r in short.history] == [(r.iteration, r.phase, r.points) for r in long]
    for one, other in zip(short.history, long, strict=True):
        np.testing.assert_allclose(one.q, other.q, rtol=0, atol=5.1e-6)
        np.testing.assert_allclose(one.base_pose, other.base_pose, rtol=0, atol=5.1e-6)
        assert one.step_rad == pytest.approx(other.step_rad, rel=1e-3)
    sizes = [len(json.dumps(result_to_mapping(r)["history"])) for r in (short, result)]
    assert sizes[0] < 0.7 * sizes[1]
    # All but the history is exact, and shortening twice is shortening once.
    whole, shortened = (result_to_mapping(r) for r in (result, short))
    assert {k: v for k, v in whole.items() if k != "history"} == {k: v for k, v in shortened.items() if k != "history"}
    assert result_to_json(with_short_history(short)) == result_to_json(short)
