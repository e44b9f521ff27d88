from ._explore import Explorer as Explorer, explore as explore
