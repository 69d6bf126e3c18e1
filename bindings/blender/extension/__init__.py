"""kinelm in Blender: dances from a language model, on the armature that is selected.

`jobs` says what can be done, `armature` turns bones into joints and back, `actions` writes keys; `operators` and `panel` are
what the user sees.
"""

import bpy

from . import operators, panel

CLASSES = [*operators.CLASSES, *panel.CLASSES]


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.kinelm = bpy.props.PointerProperty(type=operators.Settings)


def unregister():
    del bpy.types.Scene.kinelm
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
