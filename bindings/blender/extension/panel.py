"""The panel in the sidebar of the 3D view."""

import bpy

from . import operators


class KINELM_PT_panel(bpy.types.Panel):
    bl_label = "kinelm"
    bl_idname = "KINELM_PT_panel"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "kinelm"

    def draw(self, context):
        layout, settings, obj = self.layout, context.scene.kinelm, context.object
        if settings.progress >= 0:
            layout.progress(factor=settings.progress, text="Esc stops it")
            return
        if not obj or obj.type != "ARMATURE":
            layout.label(text="Click a bone of an armature", icon="ARMATURE_DATA")
            return
        found, at = operators.variations(obj)
        if found:
            layout.label(text=f"{found[at].name} ({at + 1} of {len(found)})", icon="ACTION")
            row = layout.row(align=True)
            for what in ("NEXT", "ACCEPT", "REJECT"):
                row.operator("kinelm.choose", text=what.title()).what = what
        first, last = operators.frames_of(context.scene)
        layout.label(text=f"Frames {first} to {last}" + ("" if context.scene.use_preview_range else "; P in the dope sheet: fewer"))
        column = layout.column(align=True)
        for name in ("count", "seed", "feet"):
            column.prop(settings, name)
        layout.prop(settings, "run")
        self._task(layout, "EDIT", settings, "given")
        for task in ("BETWEEN", "LOOP", "LOCK_FEET"):
            self._task(layout, task, settings)
        self._task(layout, "DANCE", settings, "labels", "seconds")
        self._task(layout, "TUNE", settings, "name", "steps")

    def _task(self, layout, task, settings, *names):
        column = layout.column(align=True)
        for name in names:
            column.prop(settings, name)
        column.operator("kinelm.run", text=next(label for name, label, _ in operators.TASKS if name == task)).task = task


CLASSES = [KINELM_PT_panel]
