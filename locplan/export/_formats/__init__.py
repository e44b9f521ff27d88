"""The formats of exports, each with its options; `locplan.export._registry` lists the modules."""
