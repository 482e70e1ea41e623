import collections.abc
import typing

import plotly.graph_objects as go

from .campaign_folder.writer import campaign_of_frames as campaign_of_frames
from .campaign_folder.writer import conditions_frame as conditions_frame
from .campaign_folder.writer import pulses_frame as pulses_frame
from .results.campaign import campaign_result as campaign_result
from .results.certification import certification_figure as certification_figure
from .results.certification import certification_result as certification_result
from .results.certification_tables import certification_table as certification_table
from .results.certification_tables import counts_frame as counts_frame
from .results.certification_tables import track_record_table as track_record_table
from .results.credibility import credibility_table as credibility_table
from .results.display import Display as Display
from .results.display import DisplayOptions as DisplayOptions
from .results.drawing import Drawing as Drawing
from .results.export.outgoing_pulses import PulseExport as PulseExport
from .results.figures import Further as Further
from .results.figures import campaign_figure as campaign_figure
from .results.figures import figure_of_test as figure_of_test
from .results.figures import overview as overview
from .results.figures import prediction_name as prediction_name
from .results.files import write_result as write_result
from .results.fit_explanations import campaign_events as campaign_events
from .results.planning import learning_curve_result as learning_curve_result
from .results.planning import next_tests_file as next_tests_file
from .results.planning import next_tests_result as next_tests_result
from .results.planning import sweep_result as sweep_result
from .results.planning import sweep_table as sweep_table
from .results.plots.conditions import next_tests_figure as next_tests_figure
from .results.plots.conditions import sweep_figure as sweep_figure
from .results.plots.learning import learning_curves as learning_curves
from .results.plots.learning import over_number_of_tests as over_number_of_tests
from .results.prediction import prediction_figure as prediction_figure
from .results.prediction import prediction_result as prediction_result
from .results.render.html import ReportForm as ReportForm
from .results.render.html import ReportOptions as ReportOptions
from .results.render.text import card as card
from .results.render.text import result_html as result_html
from .results.result_tables import metrics_table as metrics_table
from .results.result_tables import pulses_table as pulses_table
from .results.result_tables import scores_table as scores_table
from .results.result_tables import study_metrics as study_metrics
from .results.result_tables import study_pulses as study_pulses
from .results.study import study_result as study_result

_P = typing.ParamSpec("_P")

def as_plotly(
    draw: collections.abc.Callable[_P, Drawing],
) -> collections.abc.Callable[_P, go.Figure]: ...
