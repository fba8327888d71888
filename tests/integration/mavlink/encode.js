// Reads lines {id, system, component, sequence, fields} and answers each with what node-mavlink makes of it:
// {length, magic, names, v1, v2} in hex.
import { createInterface } from 'node:readline'
import { mavlink, messageOf, registry } from './messages.js'

for await (const line of createInterface({ input: process.stdin })) {
  const { id, system, component, sequence, fields } = JSON.parse(line)
  const message = messageOf(id, fields)
  // Version 1 has one byte for a message's number.
  const v1 = id < 256 ? new mavlink.MavLinkProtocolV1(system, component).serialize(message, sequence) : Buffer.alloc(0)
  const v2 = new mavlink.MavLinkProtocolV2(system, component).serialize(message, sequence)
  const type = registry[id]
  console.log(JSON.stringify({
    length: type.PAYLOAD_LENGTH, magic: type.MAGIC_NUMBER, names: type.FIELDS.map(field => field.source),
    v1: v1.toString('hex'), v2: v2.toString('hex')
  }))
}
