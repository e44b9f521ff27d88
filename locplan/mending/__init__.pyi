from ._figures import mended_figure as mended_figure
from ._mend import MapVerdict as MapVerdict, Mended as Mended, mend as mend
from ._offer import check_concerned as check_concerned, offer as offer
