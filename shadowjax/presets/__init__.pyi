from .base import Parameter as Parameter
from .base import Preset as Preset
from .registry import PRESETS as PRESETS
from .registry import make_preset as make_preset
from .registry import named_technique as named_technique
from .registry import preset as preset
