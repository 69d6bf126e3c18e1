from . import _program

_program()
