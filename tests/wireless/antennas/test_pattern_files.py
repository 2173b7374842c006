"""Pattern files against known patterns that were written into them, and damaged ones."""

import numpy as np
import pytest

from wireless import Array, FileError, MountedArray, terminal_named
from wireless.antennas.elements import SectorElement, directivity, element_named, mean_power
from wireless.antennas.pattern_files import read_pattern
from wireless.antennas.sphere import unit_vector

ANGLES = np.arange(360.0)


def at(azimuth_deg, elevation_deg):
    azimuth, elevation = np.broadcast_arrays(np.atleast_1d(azimuth_deg), elevation_deg)
    return unit_vector(np.radians(azimuth), np.radians(elevation))


def gain_dbi(element, azimuth_deg, elevation_deg):
    return 20 * np.log10(element.amplitude(at(azimuth_deg, elevation_deg)))


def write_msi(path, across, along, gain="GAIN 13.5 dBi"):
    """A file of two cuts, as functions of the azimuth and of the elevation in front and behind."""
    lines = ["NAME sector", "FREQUENCY 3500", gain, "TILT ELECTRICAL", "COMMENT \xe9"]
    for key, cut in (("HORIZONTAL", across), ("VERTICAL", along)):
        lines += [f"{key} 360", *(f"{angle:.1f} {cut(angle):.6f}" for angle in ANGLES)]
    path.write_text("\n".join(lines), "latin-1")
    return path


def signed(angle):
    return (angle + 180) % 360 - 180


@pytest.fixture
def sector(tmp_path):
    """Broader to the right, tilted down by 6 degrees (1.08 dB at the horizon), 25 dB weaker behind."""

    def across(clockwise):
        width = 80 if signed(clockwise) > 0 else 60
        return min(along(0) + 12 * (signed(clockwise) / width) ** 2, 25)

    def along(down):
        return min(12 * (signed(down - 6) / 20) ** 2, 25)

    return write_msi(tmp_path / "sector.msi", across, along), across, along


def test_cuts_are_met(sector):
    """Right is clockwise, down is below the horizon; both cuts hold to 1e-5 dB, in front and behind."""
    path, across, along = sector
    element = element_named(str(path))
    right = [13.5 - across(angle) for angle in ANGLES]
    np.testing.assert_allclose(gain_dbi(element, -ANGLES, 0), right, atol=1e-5)
    front, behind = np.arange(-90, 91), np.arange(90, 271)
    np.testing.assert_allclose(
        gain_dbi(element, 0, -front), [13.5 - along(angle) for angle in front], atol=1e-5
    )
    np.testing.assert_allclose(
        gain_dbi(element, 180, behind - 180), [13.5 - along(angle) for angle in behind], atol=1e-5
    )


def test_sum_of_symmetric_cuts_is_the_sum_of_attenuations(tmp_path):
    """The element of TR 38.901 from its own cuts, where neither reaches its floor: 12 (a/65)^2 + 12 (e/65)^2 dB.

    The part of the cut behind adds |a|/180 of its excess: bound 1 dB within 30 degrees (measured 0.9), 0.01 dB on cuts.
    """

    def cut(angle):
        return min(12 * (signed(angle) / 65) ** 2, 30)

    element = read_pattern(write_msi(tmp_path / "a.pln", cut, cut, gain="GAIN 9.5 dBi"))
    azimuth, elevation = np.meshgrid(np.linspace(-30, 30, 13), np.linspace(-30, 30, 13))
    got = gain_dbi(element, azimuth.ravel(), elevation.ravel()) - 9.5
    want = 20 * np.log10(SectorElement().amplitude(at(azimuth.ravel(), elevation.ravel())))
    assert np.abs(got - want).max() < 1.0
    on_cuts = (azimuth.ravel() == 0) | (elevation.ravel() == 0)
    assert np.abs(got - want)[on_cuts].max() < 0.01


def write_grid(path, element, step=3, add_db=0.0):
    azimuth, elevation = np.meshgrid(np.arange(-180, 180, step), np.arange(-90, 91, step))
    gain = add_db + 20 * np.log10(np.maximum(element.amplitude(at(azimuth.ravel(), elevation.ravel())), 1e-9))
    rows = zip(azimuth.ravel(), elevation.ravel(), gain, strict=True)
    path.write_text(
        "azimuth_deg,elevation_deg,gain_dbi\n" + "".join(f"{a},{e},{g:.6f}\n" for a, e, g in rows)
    )
    return path


def test_grids_are_interpolated_around_the_circle(tmp_path):
    """A grid of 3 degrees of the sector element: 0.02 dB in between (12 (1.5/65)^2 each), also across +-180 degrees.

    Chords lie below the parabola: the directivity is 0.2 % more (bound 0.3 %).
    """
    element = read_pattern(write_grid(tmp_path / "a.csv", SectorElement()))
    rng = np.random.default_rng(2)
    azimuth, elevation = rng.uniform(-180, 180, 500), rng.uniform(-90, 90, 500)
    want = 20 * np.log10(SectorElement().amplitude(at(azimuth, elevation)))
    error = np.abs(gain_dbi(element, azimuth, elevation) - want)
    assert np.quantile(error, 0.9) < 0.02
    assert gain_dbi(element, 179.999, 10) == pytest.approx(gain_dbi(element, -179.999, 10), abs=1e-3)
    ahead = at(0, 0)
    assert directivity(element, ahead) == pytest.approx(directivity(SectorElement(), ahead), rel=3e-3)


def test_gain_is_as_given_or_that_of_the_pattern(sector):
    """DBd are 2.15 dB above dBi; arrays and terminals scale to directivity unless the gain is to be as given."""
    path, *_ = sector
    text = path.read_text("latin-1")
    for words in ("GAIN 11.35", "gain 11.35 dBd"):
        path.write_text(text.replace("GAIN 13.5 dBi", words), "latin-1")
        assert gain_dbi(read_pattern(path), 0, -6)[0] == pytest.approx(13.5, abs=1e-5)
    element = element_named(str(path))
    array = Array(element=element, position_wl=np.zeros((1, 3)))
    one = np.zeros(1), np.radians(np.full(1, -6.0)), np.zeros(1, int)
    given, scaled = (
        np.abs(MountedArray(array=array, scaling=scaling).response(*one)[0, 0, 0]) ** 2
        for scaling in ("given", "directivity")
    )
    assert 10 * np.log10(given) == pytest.approx(13.5, abs=1e-5)
    assert scaled == pytest.approx(directivity(element, at(0, -6))[0], rel=1e-9)
    assert terminal_named("gnb", str(path)).weight.shape == (48, 16)


def test_a_full_turn_and_rounding_are_the_same_angle(sector):
    """Files that repeat the first angle as 360 or 1e-14 have the pattern of those that do not."""
    path, across, _ = sector
    want = gain_dbi(read_pattern(path), ANGLES, 10)
    text = path.read_text("latin-1")
    for angle in ("1e-14", "360"):
        repeated = f"HORIZONTAL 361\n{angle} {across(0)}\n"
        path.write_text(text.replace("HORIZONTAL 360\n", repeated), "latin-1")
        np.testing.assert_array_equal(gain_dbi(read_pattern(path), ANGLES, 10), want)


DAMAGED_MSI = [
    (lambda lines: [line for line in lines if "GAIN" not in line], "no line GAIN"),
    (lambda lines: [*lines[:2], "GAIN loud", *lines[3:]], "line 3 has 'loud', expected a number"),
    (lambda lines: [*lines[:2], "GAIN 3 W", *lines[3:]], "line 3 has the unit 'W', expected dBd or dBi"),
    (lambda lines: [*lines[:2], "GAIN 1e9 dBi", *lines[3:]], "GAIN of row 1 is 1000000000.0, expected -300 to 100"),
    (lambda lines: lines[:300], "line 6 announces 360 angles, expected 1 to 3600, as many as lines follow"),
    (lambda lines: lines[:366], "no line VERTICAL"),
    (lambda lines: [*lines[:9], "3.0", *lines[10:]], "line 10 has '3.0', expected an angle and an attenuation"),
    (lambda lines: [*lines[:9], "3.0 nan", *lines[10:]], "line 10 has '3.0 nan'"),
    (lambda lines: [*lines[:5], "HORIZONTAL 200", *lines[6:206], *lines[366:]], "leaves out 161 degrees after 199"),
]  # fmt: skip
DAMAGED_CSV = [
    (lambda lines: [lines[0].replace("gain_dbi", "gain"), *lines[1:]], "column gain_dbi is missing"),
    (lambda lines: lines[:-1], "there is no gain at azimuth 177 and elevation 90"),
    (lambda lines: [*lines[:5], "0,95,1.0", *lines[6:]], "elevation_deg of row 5 is 95.0, expected -90 to 90"),
    (lambda lines: [*lines, *(f"{k / 50},{k / 50},0" for k in range(4000))], "it has 11320 rows for 16"),
    (lambda lines: [*lines, "0,0,7.5"], "gives a direction another gain than a later row"),
    (lambda lines: [line for line in lines if line[0] != "-"], "azimuth_deg leaves out 183 degrees after 177"),
    (lambda lines: [line for line in lines if ",-" not in line], "elevation_deg leaves out more than 45 degrees"),
    (lambda lines: lines[:1], "not readable as an antenna pattern (CSV parse error"),
]  # fmt: skip


@pytest.mark.parametrize(("damage", "words"), DAMAGED_MSI)
def test_damaged_cuts_are_rejected(sector, damage, words):
    """In one line that names the file, what is wrong and where, and what would be right."""
    path, _, _ = sector
    path.write_text("\n".join(damage(path.read_text("latin-1").splitlines())), "latin-1")
    with pytest.raises(FileError) as rejected:
        element_named(str(path))
    message = str(rejected.value)
    assert words in message and message.startswith(str(path)) and "\n" not in message
    assert "Give GAIN, HORIZONTAL and VERTICAL" in message


@pytest.mark.parametrize(("damage", "words"), DAMAGED_CSV)
def test_damaged_grids_are_rejected(tmp_path, damage, words):
    """In one line, likewise."""
    path = write_grid(tmp_path / "a.csv", SectorElement())
    path.write_text("\n".join(damage(path.read_text().splitlines())))
    with pytest.raises(FileError) as rejected:
        element_named(str(path))
    message = str(rejected.value)
    assert words in message and message.startswith(str(path)) and "\n" not in message
    assert "Give columns azimuth_deg, elevation_deg, gain_dbi" in message


def twin(angle):
    """Two beams at 30 degrees to the right and left, 10.6 dB lower in between."""
    return min(12 * ((abs(signed(angle)) - 30) / 33) ** 2, 30)


def beam(angle):
    """A beam of 10 degrees at the horizon."""
    return min(12 * (signed(angle) / 10) ** 2, 30)


def test_read_pattern_of_twin_beams_has_its_gain_in_both(tmp_path):
    """The vertical cut lies in a beam, not between them: 17 dBi there and 12 (30/33)^2 = 9.92 dB less ahead."""
    element = read_pattern(write_msi(tmp_path / "a.msi", twin, beam, "GAIN 17 dBi"))
    np.testing.assert_allclose(gain_dbi(element, [-30, 0, 30], 0), [17, 17 - 9.917, 17], atol=1e-3)
    assert element.gain_dbi.max() == pytest.approx(17)


def test_read_pattern_of_a_tilted_cut_keeps_the_maximum(tmp_path):
    """Cuts that are each relative to their own maximum, with 6 degrees of tilt: no direction is above the gain."""
    element = read_pattern(
        write_msi(tmp_path / "a.msi", lambda a: min(12 * (signed(a) / 65) ** 2, 30), lambda e: beam(e - 6))
    )
    assert element.gain_dbi.max() == pytest.approx(13.5) == gain_dbi(element, 0, -6)[0]


def test_read_pattern_takes_relative_gains(tmp_path, caplog):
    """Attenuations with a minus sign are those without, with a warning."""
    want = read_pattern(write_msi(tmp_path / "a.msi", twin, beam))
    element = read_pattern(write_msi(tmp_path / "b.msi", lambda a: -twin(a), lambda e: -beam(e)))
    np.testing.assert_array_equal(element.gain_dbi, want.gain_dbi)
    assert "b.msi: no attenuation of HORIZONTAL is positive" in caplog.text


@pytest.mark.parametrize("excess_db", [-3.0, -0.1, 1.0, 10.0])
@pytest.mark.parametrize("kind", ["cuts", "grid"])
def test_read_pattern_radiates_at_most_what_it_is_given(tmp_path, kind, excess_db):
    """Patterns above their directivity are rejected; the mean gain of the others is at most 1.13, on another grid."""
    if kind == "cuts":
        path = write_msi(tmp_path / "a.msi", lambda a: min(12 * (signed(a) / 65) ** 2, 30), beam)
        directivity_dbi = 13.5 - 10 * np.log10(mean_power(read_pattern(path), 150))
        gain = f"GAIN {directivity_dbi + excess_db} dBi"
        write_msi(path, lambda a: min(12 * (signed(a) / 65) ** 2, 30), beam, gain)
    else:
        path = write_grid(tmp_path / "a.csv", SectorElement(), add_db=9.83 + excess_db)
    if excess_db > 0.6:
        with pytest.raises(FileError, match=r"radiates .* times the power"):
            read_pattern(path)
    else:
        assert 10 * np.log10(mean_power(read_pattern(path), 150)) == pytest.approx(excess_db, abs=0.05)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda text: text.replace("HORIZONTAL 360\n0.0", "HORIZONTAL 361\n0.0 3\n0.0"), "the angle 0 twice"),
        (lambda text: text.replace("\n90.0 ", "\n91.0 ", 1), "the angle 91 twice"),
        (
            lambda text: "\n".join(line for line in text.split("\n") if not line.startswith("12")).replace(
                " 360", " 349"
            ),
            "HORIZONTAL leaves out 11 degrees after 119",
        ),
    ],
)
def test_read_pattern_rejects_cuts_with_wrong_angles(sector, change, reason):
    path, *_ = sector
    path.write_text(change(path.read_text("latin-1")), "latin-1")
    with pytest.raises(FileError, match=reason):
        read_pattern(path)


@pytest.mark.parametrize(
    ("name", "peak", "gain", "warning"),
    [
        ("a.msi", 0, "GAIN 13.5 dBi", ""),
        ("a.MSI", 6, "GAIN 13.5 dBi", ""),
        (
            "a.msi",
            90,
            "GAIN 13.5 dBi",
            "VERTICAL is strongest at 90 degrees. Do its angles count from the hor",
        ),
        ("a.msi", 0, "GAIN 0 dBi", "dB less than it is given. Are its gains relative"),
    ],
)
def test_read_pattern_warns_of_cuts_from_the_zenith_and_of_relative_gains(
    tmp_path, caplog, name, peak, gain, warning
):
    """A beam that a vertical cut has at 90 degrees looks straight down, as that of angles from the zenith would."""
    element_named(str(write_msi(tmp_path / name, twin, lambda angle: beam(angle - peak), gain)))
    assert warning in caplog.text and bool(warning) == bool(caplog.text)
