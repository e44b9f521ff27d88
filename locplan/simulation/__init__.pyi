from . import driver as driver, levels as levels, verdict as verdict
from ._advice_figures import choice_figure as choice_figure, tuning_figure as tuning_figure
from ._arrivals import (
    ABORTED as ABORTED,
    ARRIVED as ARRIVED,
    ELSEWHERE as ELSEWHERE,
    FOLLOWER as FOLLOWER,
    TIMED_OUT as TIMED_OUT,
    WORLD as WORLD,
    Arrival as Arrival,
    Arrivals as Arrivals,
    Closed as Closed,
)
from ._drives import (
    DRIVEN as DRIVEN,
    FLOOR as FLOOR,
    LOST as LOST,
    PROFILE as PROFILE,
    RATES as RATES,
    DriveArguments as DriveArguments,
    Drives as Drives,
    Rated as Rated,
    check_drives as check_drives,
    drive_arguments as drive_arguments,
    rates_of as rates_of,
    rmse_ratio as rmse_ratio,
)
from ._figures import (
    queries_figure as queries_figure,
    simulation_figure as simulation_figure,
)
from ._routes import (
    Route as Route,
    Routes as Routes,
    RoutesOnMaps as RoutesOnMaps,
    simulate_queries as simulate_queries,
)
from ._simulate import Simulation as Simulation, simulate as simulate
from ._simulator import Simulator as Simulator
from ._worlds import (
    POSE_SPACING as POSE_SPACING,
    about_filter as about_filter,
    check_filter_map as check_filter_map,
    check_of_one_map as check_of_one_map,
    poses_along as poses_along,
)
from .choice._ask import ChoiceSettings as ChoiceSettings
from .choice._choice import Choice as Choice
from .choice._choices import (
    Choices as Choices,
    read_choices as read_choices,
)
from .choice._choose import choose as choose
from .choice._choose_many import (
    choose_many as choose_many,
)
from .choice._race import Judgement as Judgement, Scores as Scores, judged as judged
from .driver import drive_closed as drive_closed, drive_open as drive_open, route_key as route_key
from .tuning._choose_preset import (
    OWN as OWN,
    Case as Case,
    PresetChoice as PresetChoice,
    choice_values as choice_values,
    choose_preset as choose_preset,
    find_objection as find_objection,
)
from .tuning._parameters import (
    BeamsLeft as BeamsLeft,
    check_tunable as check_tunable,
    filter_warnings as filter_warnings,
    is_untuned as is_untuned,
    warn_of_settings as warn_of_settings,
    write_tuned as write_tuned,
)
from .tuning._results import Tuning as Tuning
from .tuning._simulated_cases import (
    cut_path as cut_path,
    plan_random_paths as plan_random_paths,
    simulated_cases as simulated_cases,
)
from .tuning._tune import (
    as_list as as_list,
    number_names as number_names,
    tune as tune,
)
