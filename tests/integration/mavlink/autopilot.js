// An autopilot of node-mavlink that flies north at 15 m/s (or SPEED) and speaks to a UDP port; asks the camera component
// questions in both styles, and writes what it hears, one JSON line each.
//   node autopilot.js PORT [SIGNING_PASSPHRASE_HEX or -] [SPEED]
import dgram from 'node:dgram'
import { PassThrough } from 'node:stream'
import { fieldsOf, mavlink, messageOf, registry } from './messages.js'

const [port, keyHex, metresPerSecond] = process.argv.slice(2)
const key = keyHex && keyHex !== '-' ? Buffer.from(keyHex, 'hex') : null
const protocol = new mavlink.MavLinkProtocolV2(1, 1, key ? mavlink.MavLinkProtocolV2.IFLAG_SIGNED : 0)
const socket = dgram.createSocket('udp4')
const booted = process.hrtime.bigint() - 500_000_000_000n  // on for 500 s
const bootNs = () => process.hrtime.bigint() - booted
let sequence = 0, signedAt = 0

function send(id, fields) {
  const defaults = fieldsOf(new registry[id]())
  let packet = protocol.serialize(messageOf(id, { ...defaults, ...fields }), sequence++ & 255)
  // Times of signatures go up, and the peer's own have whole milliseconds.
  if (key) packet = protocol.sign(packet, 1, key, signedAt = Math.max(Date.now(), signedAt + 1))
  socket.send(packet, Number(port), '127.0.0.1')
}

const speed = Number(metresPerSecond ?? 15), lat0 = 47.3977, lon0 = 8.5456
setInterval(() => send(0, { type: 2, autopilot: 3, base_mode: 209, system_status: 4, mavlink_version: 3 }), 300)
setInterval(() => send(2, { time_unix_usec: String(BigInt(Date.now()) * 1000n), time_boot_ms: Number(bootNs() / 1000000n) }), 300)
setInterval(() => {
  const ms = Number(bootNs() / 1000000n)
  const north = speed * (ms - 500000) / 1000
  send(24, { time_usec: String(bootNs() / 1000n), fix_type: 6, lat: Math.round(lat0 * 1e7), lon: Math.round(lon0 * 1e7),
             alt: 488000, alt_ellipsoid: 535000, h_acc: 20, v_acc: 30, eph: 80, epv: 80, vel: speed * 100, cog: 0,
             satellites_visible: 20 })
  send(33, { time_boot_ms: ms, lat: Math.round((lat0 + north / 111180.0) * 1e7), lon: Math.round(lon0 * 1e7),
             alt: 488000, relative_alt: 100000, vx: speed * 100, vy: 0, vz: 0, hdg: 0 })
}, 100)
setInterval(() => send(31, { time_boot_ms: Number(bootNs() / 1000000n), q1: 1, q2: 0, q3: 0, q4: 0, rollspeed: 0,
                             pitchspeed: 0, yawspeed: 0, repr_offset_q: [0, 0, 0, 0] }), 20)
const command = (id, param1 = 0, param2 = 0) => send(76, { command: id, param1, param2, target_system: 1, target_component: 100 })
const questions = [[512, 259], [521], [512, 260], [522], [512, 261], [525, 1], [512, 262], [527], [512, 9999], [2002, 0]]
setInterval(() => { const next = questions.shift(); if (next) command(...next) }, 100)

const input = new PassThrough()
input.pipe(new mavlink.MavLinkPacketSplitter()).pipe(new mavlink.MavLinkPacketParser()).on('data', packet => {
  const type = registry[packet.header.msgid]
  if (!type) return
  const fields = fieldsOf(packet.protocol.data(packet.payload, type))
  if (type.MSG_NAME === 'TIMESYNC' && fields.tc1 === '0') {
    send(111, { tc1: bootNs().toString(), ts1: fields.ts1, target_system: 0, target_component: 0 })
  }
  console.log(JSON.stringify({
    name: type.MSG_NAME, system: packet.header.sysid, component: packet.header.compid,
    signed: packet.signature ? (key ? packet.signature.matches(key) : false) : null, fields
  }))
})
socket.on('message', bytes => input.write(bytes))
socket.bind(0, '127.0.0.1')
process.stdin.on('end', () => process.exit(0))
process.stdin.resume()
