"""Public names, which `lazy_loader` imports when they are first used."""

from .mavlink import HeardVehicle as HeardVehicle
from .mavlink import LinkError as LinkError
from .mavlink import LinkLimits as LinkLimits
from .mavlink import Station as Station
from .mavlink import VehicleLink as VehicleLink
from .mavlink import open_link as open_link
from .mission_protocol import clear_items as clear_items
from .mission_protocol import compare_items as compare_items
from .mission_protocol import download_items as download_items
from .mission_protocol import upload_items as upload_items
from .onboard import Cargo as Cargo
from .onboard import Seat as Seat
from .onboard import pair as pair
from .onboard import read_cargos as read_cargos
from .onboard import read_seats as read_seats
from .simulated import Quirks as Quirks
from .simulated import SimulatedLink as SimulatedLink
from .simulated import SimulatedVehicle as SimulatedVehicle
from .simulated import run_vehicles as run_vehicles
from .starting import Fleet as Fleet
from .starting import check_fleet as check_fleet
from .starting import start_missions as start_missions
from .starting import watch_fleet as watch_fleet
from .uploading import Delivery as Delivery
from .uploading import stations as stations
from .uploading import upload_missions as upload_missions
