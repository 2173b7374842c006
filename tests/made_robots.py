"""Small robots in URDF and MJCF, with known sizes."""

WHEEL = """
<joint name="{side}_joint" type="continuous"><parent link="base"/><child link="{side}"/>
  <origin xyz="{x} {y} 0.04" rpy="-1.570796 0 0"/><axis xyz="0 0 {axis}"/></joint>
<link name="{side}"><collision><geometry><cylinder length="0.02" radius="0.05"/></geometry></collision>
  <inertial><mass value="0.2"/><inertia ixx="1e-4" iyy="1e-4" izz="2.5e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
URDF = """<?xml version="1.0"?>
<!-- ${a comment} -->
<robot name="cart">
<link name="footprint"/>
<joint name="up" type="fixed"><parent link="footprint"/><child link="base"/><origin xyz="0 0 0.01"/></joint>
<link name="base"><visual><geometry><mesh filename="package://cart/body.stl"/></geometry></visual>
  <collision><origin xyz="0.1 0 0.1"/><geometry><box size="0.4 0.2 0.1"/></geometry></collision>
  <inertial><origin xyz="0.05 0 0.1"/><mass value="3"/>
    <inertia ixx="0.02" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
WHEELS
<joint name="scan_joint" type="fixed"><parent link="base"/><child link="base_scan"/>
  <origin xyz="0.2 0 0.24"/></joint><link name="base_scan"/>
<joint name="camera_joint" type="fixed"><parent link="base"/><child link="camera_link"/>
  <origin xyz="0.28 0 0.14"/></joint><link name="camera_link"/>
</robot>"""
TWO = WHEEL.format(side="left", x=0, y=0.15, axis=1) + WHEEL.format(side="right", x=0, y=-0.15, axis=-1)
MJCF = """<mujoco model="disk"><worldbody><geom type="plane" size="5 5 .1"/>
<body name="base" pos="1 2 0.05"><freejoint/>
  <geom type="cylinder" size="0.2 0.03" mass="4"/>
  <camera name="eye" pos="0.1 0 0.3" fovy="75" xyaxes="0 -1 0 0 0 1"/>
  <body name="l" pos="0 0.15 -0.02"><joint name="l" axis="0 -1 0" damping="0.01"/>
    <geom type="cylinder" size="0.03 0.01" euler="90 0 0" mass="0.1"/></body>
  <body name="r" pos="0 -0.15 -0.02"><joint name="r" axis="0 -1 0" damping="0.01"/>
    <geom type="cylinder" size="0.03 0.01" euler="90 0 0" mass="0.1"/></body>
  <body name="caster" pos="0.15 0 -0.04"><joint axis="0 0 1"/><geom type="sphere" size="0.01" mass="0.02"/></body>
</body></worldbody>
<actuator><velocity joint="l"/><velocity joint="r"/></actuator><sensor><jointvel joint="l"/></sensor>
<keyframe><key qpos="0 0 .06 1 0 0 0 0 0 0"/></keyframe></mujoco>"""
