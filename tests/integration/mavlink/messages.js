// Messages by their wire names, through node-mavlink.
import { createRequire } from 'node:module'

const require = createRequire(process.env.OVERFLY_PEER_MODULES + '/')
export const mavlink = require('node-mavlink')
const mappings = require('mavlink-mappings')

export const registry = {
  ...mappings.minimal.REGISTRY, ...mappings.common.REGISTRY, ...mappings.standard.REGISTRY,
  ...mappings.ardupilotmega.REGISTRY
}

const isBig = type => type.startsWith('uint64') || type.startsWith('int64')

// {wire name: value} to a message; 64-bit integers come as text.
export function messageOf(id, fields) {
  const type = registry[id]
  const message = new type()
  for (const field of type.FIELDS) {
    const value = fields[field.source]
    if (value === undefined) throw new Error(`${type.MSG_NAME} has a field ${field.source} that is not sent`)
    message[field.name] = isBig(field.type) ? BigInt(value) : value
  }
  return message
}

export function fieldsOf(message) {
  const fields = {}
  for (const field of message.constructor.FIELDS) {
    const value = message[field.name]
    fields[field.source] = typeof value === 'bigint' ? value.toString() : value
  }
  return fields
}
