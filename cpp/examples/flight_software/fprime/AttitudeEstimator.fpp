# The model of the component, in F´'s language. It was not given to F´'s tools: AttitudeEstimatorComponentAc.hpp, which they would make of it,
# is a stub here.
module Adcs {

  array Vector = [3] F64
  array Attitude = [9] F64

  @ A star: its direction in reference axes, as measured in body axes, and the largest angle between both, rad
  struct Star {
    reference: Vector
    body: Vector
    bound: F64
  }
  array Stars = [4] Star

  @ The sensors of one moment
  struct Sample {
    seconds: F64 @< of the samples
    rate: Vector @< of the gyro, rad/s
    count: U32 @< of the stars
    stars: Stars
  }

  port SampleIn(ref sample: Sample)

  @ The guaranteed filter of a gyro
  active component AttitudeEstimator {
    async input port sampleIn: SampleIn
    async command FORGET

    telemetry Knows: bool
    telemetry Attitude: Attitude
    telemetry HalfWidths: Vector @< of the attitude, about the body axes, rad
    telemetry Conditional: bool
    telemetry Margin: F64
    telemetry Iterations: I32
    telemetry LimitsHit: U32

    event Refused(what: string size 16, why: string size 96) severity warning high format "{}: {}"
    event LeftOut(stars: U32) severity activity high format "left out stars {}"

    command recv port cmdIn
    command reg port cmdRegOut
    command resp port cmdResponseOut
    event port eventOut
    text event port textEventOut
    telemetry port tlmOut
    time get port timeGetOut
  }
}
