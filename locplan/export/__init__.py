"""Files for navigation stacks: ROS 2 Nav2 and ROS 1.

Folders are written whole or not at all, with a README.md that says what each file is and how to
launch it.
"""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
