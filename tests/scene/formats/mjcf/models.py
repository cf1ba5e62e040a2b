"""Models of MuJoCo of the tests: robots of rods, struts and stages, and bodies in all ways to write them."""

from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.formats.import_mjcf import import_mjcf
from tensegrity_codegen.scene.formats.imported import ImportResult

ROD = """
  <body name="{name}" pos="{pos}" quat="0.927160881 -0.0969700367 -0.361897104 0">
   <freejoint/>
   <geom name="tube_{name}" type="cylinder" size="0.008 0.17" mass="0.06"/>
   <geom name="low_{name}" type="sphere" size="0.024" pos="0 0 -0.17" mass="0.02"/>
   <geom type="sphere" size="0.024" pos="0 0 0.17" mass="0.02"/>
   <geom type="cylinder" size="0.018" fromto="0 0 -0.153 0 0 -0.085" mass="0.07"/>
   <geom type="cylinder" size="0.018" fromto="0 0 0.085 0 0 0.153" mass="0.07"/>
   <site name="{name}_out" pos="0.02 0 -0.1615"/> <site name="{name}_in" pos="-0.02 0 -0.1615"/>
   <site name="{name}_top" pos="0 0.02 0.1615"/>
  </body>"""

ROBOT = f"""<mujoco model="robot">
 <compiler angle="degree" inertiafromgeom="true" autolimits="true"/>
 <option gravity="0 0 -9.81" cone="elliptic"/>
 <default>
  <geom condim="3" friction="0.8 0.005 0.0001" solref="-5000 -50"/>
  <general dyntype="filter" dynprm="0.05"/>
  <default class="string"><tendon stiffness="500" damping="3"/></default>
 </default>
 <worldbody>
  <geom name="floor" type="plane" size="5 5 1" pos="0 0 -0.1" euler="0 10 0"/>
  <site name="hook" pos="0 0 1"/> <site name="far" pos="0 0 2"/>
{ROD.format(name="rod0", pos="0 0.03 0.15")}{ROD.format(name="rod1", pos="0.3 0 0.15")}
 </worldbody>
 <tendon>
  <spatial name="a" class="string" springlength="0 0.16">
   <site site="rod0_out"/><site site="rod1_in"/></spatial>
  <spatial name="b" class="string" springlength="0 0.2">
   <site site="rod0_out"/><site site="rod1_in"/></spatial>
  <spatial name="c" stiffness="700" springlength="0 0.8"><site site="hook"/><site site="rod0_top"/></spatial>
  <spatial name="d" stiffness="300"><site site="hook"/><site site="rod1_top"/></spatial>
  <spatial name="over" stiffness="90" springlength="0 0.9">
   <site site="rod0_top"/><site site="hook"/><site site="rod1_top"/></spatial>
  <spatial name="line"><site site="rod0_in"/><site site="far"/></spatial>
 </tendon>
 <actuator>
  <position name="servo" tendon="a" kp="400" kv="2" ctrlrange="0.1 0.3"/>
  <general name="pull" tendon="c" gainprm="7" gear="-2" ctrlrange="0 5"/>
  <motor name="winch" tendon="b" gear="-50"/>
  <position name="both" tendon="d" kp="100"/>
  <motor name="free" tendon="line"/>
  <muscle name="muscle" tendon="c"/>
 </actuator>
 <sensor>
  <framepos name="p" objtype="site" objname="rod0_in"/>
  <gyro name="g" site="rod0_out" noise="0.01"/>
  <tendonpos name="l" tendon="c"/>
  <actuatorfrc name="f" actuator="servo"/>
  <tendonvel name="v" tendon="c"/>
  <accelerometer name="acc" site="rod0_out"/>
 </sensor>
</mujoco>
"""

FREE = "<freejoint/>"
# Bodies b with masses in all ways to write them; all have the site s.
BODIES = {
    "shapes": f"""<body name="b" pos="0.1 0.2 0.3" axisangle="1 2 3 40">{FREE}<site name="s" pos="1 2 3"/>
      <geom name="g1" type="capsule" size="0.05 0.2" euler="10 20 30"/>
      <geom name="g2" type="cylinder" size="0.05" fromto="0 0.1 0.2 0.3 -0.1 0.5" density="300"/>
      <geom name="g3" type="box" size="0.1 0.2 0.3" pos="0.3 0 0" xyaxes="1 1 0 -1 1 0.2"/>
      <geom name="g4" type="ellipsoid" size="0.1 0.2 0.3" zaxis="1 0 1" mass="3"/>
      <geom name="g5" size="0.1" pos="0 0 1"/></body>""",
    "between points": f"""<body name="b">{FREE}<site name="s" type="capsule" size="1" fromto="0 0 0 1 1 1"/>
      <geom name="g1" type="box" size="0.03" fromto="0.5 0 0.1 -0.4 0.25 1.1" mass="1.5"/>
      <geom name="g2" type="ellipsoid" size="0.03" fromto="0.5 0 0.1 -0.4 0.25 1.1"/>
      <geom name="g3" type="capsule" size="0.02" fromto="0 0 0 0 0 -1"/></body>""",
    "inertial": f"""<body name="b" pos="1 0 0" euler="0 0 90">{FREE}<site name="s"/>
      <inertial pos="0.1 0.2 0.3" euler="30 40 50" mass="2" diaginertia="0.3 0.2 0.15"/>
      <geom name="g1" size="1"/></body>""",
    "full inertia": f"""<body name="b">{FREE}<site name="s"/>
      <inertial pos="0.1 0.2 0.3" mass="2" fullinertia="0.3 0.2 0.15 0.01 -0.02 0.03"/></body>""",
    "welded": f"""<body name="b" pos="0 0 1" quat="1 2 3 4">{FREE}<geom name="g1" size="0.1"/>
      <body pos="0 0.5 0" euler="90 0 0"><geom name="g2" type="box" size="0.1 0.2 0.3"/><site name="s"/>
      <body name="in" pos="0.1 0 0"><inertial pos="0 0 0.1" mass="1" diaginertia="1 1.5 2"/></body>
      </body></body>""",
    "classes": f"""<body name="b" childclass="heavy">{FREE}<geom name="g1"/><site name="s" pos="0 0 1"/>
      <geom name="g2" class="long" pos="0 1 0"/><body childclass="long"><geom name="g3"/></body></body>""",
    "joint of a class": """<body name="b" childclass="floating"><joint/>
      <geom name="g1" size="0.1 0.2 0.3" type="box"/><site name="s"/></body>""",
    "frames": f"""<frame pos="0 0 1" euler="0 90 0" childclass="heavy"><body name="b" pos="1 0 0">{FREE}
      <geom name="g1"/><frame quat="0 1 0 0" pos="1 1 1"><geom name="g2" type="box" size="0.1 0.2 0.3"/>
      <site name="s" pos="0 0 1"/></frame></body></frame>""",
}
HEAD = """<mujoco><compiler {}/><default><default class="heavy">
 <geom type="cylinder" size="0.1 0.2" density="5000"/>
 <default class="long"><geom size="0.1 0.9" mass="3"/></default></default>
 <default class="floating"><joint type="free"/></default></default><worldbody>"""


def write_body(name: str, compiler: str = "") -> str:
    """Return the model of one of `BODIES`; compiler: its attributes."""
    return f"{HEAD.format(compiler)}{BODIES[name]}</worldbody></mujoco>"


def load(tmp_path: Path, text: str, **options: Any) -> ImportResult:
    """Return the scene of a model."""
    path = tmp_path / "model.xml"
    path.write_text(text, encoding="utf-8")
    return import_mjcf(path, **options)
