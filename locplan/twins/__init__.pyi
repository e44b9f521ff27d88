from ._figures import twins_figure as twins_figure
from ._find import find_twins as find_twins
from ._matching import Matching as Matching
from ._starts import Start as Start
from ._symmetries import Symmetry as Symmetry
from ._trials import GlobalMatches as GlobalMatches
from ._twins import LAYERS as LAYERS, Twin as Twin, Twins as Twins
