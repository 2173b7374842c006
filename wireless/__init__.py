"""Radio in buildings: materials of walls, what they do to a wave, and the paths between points.

Knows nothing of robots: a mesh and points come in, radio quantities go out.

    Tracer               a building made ready for tracing
    TracerConfig         which paths are looked for
    Scene                what it takes in place of a mesh: a mesh with materials
    Paths                what comes out: one row per path, as columns
    LinkState            line of sight, first order, higher order, outage
    Interaction          what happens to a path at a point
    SceneError           a mesh that cannot be traced

Materials:

    MATERIALS            radio materials by name, as measured over ranges of frequencies
    Material             a wall of layers of your own
    Layer                one of them
    permittivity         complex relative permittivity of one at a frequency

Measurements and what is made out of them:

    terminal_named       antenna arrays and beams of the reference's base station or robot
    Terminal             one of your own: a platform and its beams
    Platform             arrays that face different directions
    uniform_array        a line or a plane of elements
    Rays                 paths as two terminals see them
    Sounder              what a receiver measures of them
    SoundingConfig       with which power and waveform
    estimator_named      what makes paths out of measurements again
    PathEstimates        these paths
    make_tokens          these paths as one array for networks
    load_classifier      networks that classify link states, from a file
    LinkStateClassifier  these networks behind one call

Files:

    read_links           links of a data set: places, states, estimates
    read_rays            true paths of these links
    LinkRecords          what `read_links` reads
    link_table           links as a table of such a file
    write_links          writes that table
    find_measurements    which public measurements a folder has
    read_measurements    public measurements of a transmitter
    Measurements         what `read_measurements` reads
    traced_csv           paths as a CSV file of mmwRobotNav
    estimated_csv        estimates as such a file
    DataError            a file that cannot be used
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING

#: Where each public name is: imported at its first use, since few programs need all of them.
_MODULES = {
    "Tracer": "tracing.tracer",
    "TracerConfig": "tracing.tracer",
    "Scene": "tracing.tracer",
    "Paths": "paths",
    "LinkState": "paths",
    "Interaction": "paths",
    "SceneError": "tracing.mesh_check",
    "MATERIALS": "em.materials",
    "Layer": "em.materials",
    "Material": "em.materials",
    "permittivity": "em.materials",
    "terminal_named": "antennas.codebook",
    "Rays": "sounding.sounder",
    "Sounder": "sounding.sounder",
    "SoundingConfig": "sounding.sounder",
    "estimator_named": "estimation.estimators",
    "PathEstimates": "estimates",
    "make_tokens": "linkstate.tokens",
    "load_classifier": "linkstate.classifier",
    "LinkStateClassifier": "linkstate.classifier",
    "read_links": "formats.link_records",
    "read_rays": "formats.link_records",
    "LinkRecords": "formats.link_records",
    "link_table": "formats.link_records",
    "write_links": "formats.link_records",
    "find_measurements": "formats.mmwrobotnav_measurements",
    "read_measurements": "formats.mmwrobotnav_measurements",
    "Measurements": "formats.mmwrobotnav_measurements",
    "traced_csv": "formats.mmwrobotnav_csv",
    "estimated_csv": "formats.mmwrobotnav_csv",
    "DataError": "support.reading",
    "Terminal": "antennas.codebook",
    "Platform": "antennas.arrays",
    "uniform_array": "antennas.arrays",
}
__all__ = ["__version__", *_MODULES]

if TYPE_CHECKING:
    from wireless.antennas.arrays import Platform as Platform
    from wireless.antennas.arrays import uniform_array as uniform_array
    from wireless.antennas.codebook import Terminal as Terminal
    from wireless.antennas.codebook import terminal_named as terminal_named
    from wireless.em.materials import MATERIALS as MATERIALS
    from wireless.em.materials import Layer as Layer
    from wireless.em.materials import Material as Material
    from wireless.em.materials import permittivity as permittivity
    from wireless.estimates import PathEstimates as PathEstimates
    from wireless.estimation.estimators import estimator_named as estimator_named
    from wireless.formats.link_records import LinkRecords as LinkRecords
    from wireless.formats.link_records import link_table as link_table
    from wireless.formats.link_records import read_links as read_links
    from wireless.formats.link_records import read_rays as read_rays
    from wireless.formats.link_records import write_links as write_links
    from wireless.formats.mmwrobotnav_csv import estimated_csv as estimated_csv
    from wireless.formats.mmwrobotnav_csv import traced_csv as traced_csv
    from wireless.formats.mmwrobotnav_measurements import Measurements as Measurements
    from wireless.formats.mmwrobotnav_measurements import find_measurements as find_measurements
    from wireless.formats.mmwrobotnav_measurements import read_measurements as read_measurements
    from wireless.linkstate.classifier import LinkStateClassifier as LinkStateClassifier
    from wireless.linkstate.classifier import load_classifier as load_classifier
    from wireless.linkstate.tokens import make_tokens as make_tokens
    from wireless.paths import Interaction as Interaction
    from wireless.paths import LinkState as LinkState
    from wireless.paths import Paths as Paths
    from wireless.sounding.sounder import Rays as Rays
    from wireless.sounding.sounder import Sounder as Sounder
    from wireless.sounding.sounder import SoundingConfig as SoundingConfig
    from wireless.support.reading import DataError as DataError
    from wireless.tracing.mesh_check import SceneError as SceneError
    from wireless.tracing.tracer import Scene as Scene
    from wireless.tracing.tracer import Tracer as Tracer
    from wireless.tracing.tracer import TracerConfig as TracerConfig

    __version__: str
else:

    def __getattr__(name: str) -> object:
        """A public name, imported at its first use."""
        if name == "__version__":
            value: object = version("robosim-wireless")
        elif name in _MODULES:
            value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
