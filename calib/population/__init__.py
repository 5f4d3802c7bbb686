"""How large errors of a kind are: a normal prior of parameters, whose widths readings may show."""
