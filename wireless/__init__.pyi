"""Public names of `wireless`."""

from wireless.tracing.tracer import Tracer as Tracer
from wireless.tracing.tracer import TracerConfig as TracerConfig
from wireless.tracing.tracer import Scene as Scene
from wireless.paths import Paths as Paths
from wireless.paths import LinkState as LinkState
from wireless.paths import Interaction as Interaction
from wireless.tracing.mesh_check import SceneError as SceneError

# Materials
from wireless.em.materials import MATERIALS as MATERIALS
from wireless.em.materials import Layer as Layer
from wireless.em.materials import Material as Material
from wireless.em.materials import permittivity as permittivity

# Channels between antennas
from wireless.channel import Channel as Channel
from wireless.channel import subcarriers as subcarriers
from wireless.coverage import CoverageMap as CoverageMap
from wireless.coverage import CellState as CellState
from wireless.antennas.mounting import MountedArray as MountedArray
from wireless.antennas.arrays import Array as Array
from wireless.antennas.elements import element_named as element_named

# Moving people
from wireless.motion.bodies import Bodies as Bodies
from wireless.motion.bodies import people as people
from wireless.motion.blockage import Blockage as Blockage
from wireless.motion.blockage import block as block
from wireless.motion.impulse_responses import ImpulseResponses as ImpulseResponses
from wireless.motion.impulse_responses import sample_channel as sample_channel

# Measurements and what is made out of them
from wireless.bands import BANDS as BANDS
from wireless.antennas.codebook import terminal_named as terminal_named
from wireless.sounding.sounder import Rays as Rays
from wireless.sounding.sounder import Sounder as Sounder
from wireless.sounding.sounder import SoundingConfig as SoundingConfig
from wireless.estimation.estimators import estimator_named as estimator_named
from wireless.estimates import PathEstimates as PathEstimates
from wireless.linkstate.tokens import make_tokens as make_tokens
from wireless.linkstate.classifier import load_classifier as load_classifier
from wireless.linkstate.classifier import LinkStateClassifier as LinkStateClassifier
from wireless.antennas.codebook import Terminal as Terminal
from wireless.antennas.arrays import Platform as Platform
from wireless.antennas.arrays import uniform_array as uniform_array

# Files
from wireless.formats.link_records import read_links as read_links
from wireless.formats.link_records import read_rays as read_rays
from wireless.formats.link_records import LinkRecords as LinkRecords
from wireless.formats.link_records import link_table as link_table
from wireless.formats.link_records import write_links as write_links
from wireless.formats.mmwrobotnav_measurements import find_measurements as find_measurements
from wireless.formats.mmwrobotnav_measurements import read_measurements as read_measurements
from wireless.formats.mmwrobotnav_measurements import Measurements as Measurements
from wireless.formats.mmwrobotnav_csv import traced_csv as traced_csv
from wireless.formats.mmwrobotnav_csv import estimated_csv as estimated_csv
from robosim.support.reading import FileError as FileError

__version__: str
