from .coverage import coverage_depth as coverage_depth
from .coverage import coverage_planes as coverage_planes
from .shadow_picture import Receiver as Receiver
from .shadow_picture import plane_receiver as plane_receiver
