"""States and unknown inputs together, without a model of the inputs."""

from backsight.estimators.joint_input.estimator import JointInput as JointInput
