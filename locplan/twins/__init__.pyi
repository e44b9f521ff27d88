from ._matching import Matching as Matching
