// A master of npm's canopen, asked to use one node: frames come and go as lines "identifier data" in hexadecimal digits.
// node canopen_master.js NODE '[[index, subindex, "name"], ...]': its last line, "=" and JSON, says what it saw.

const { Device, DataType } = require('canopen');
const readline = require('readline');

const node = Number(process.argv[2]);
const objects = JSON.parse(process.argv[3]);
const device = new Device({ id: 0x7e });
const seen = { objects: {}, beats: [], pdos: {} };
const pause = (seconds) => new Promise((done) => setTimeout(done, 1000 * seconds));

device.addListener('message', ({ id, data }) => console.log(`${id.toString(16)} ${Buffer.from(data).toString('hex')}`));
readline.createInterface({ input: process.stdin }).on('line', (line) => {
    const [id, data] = line.split(' ');
    device.receive({ id: parseInt(id, 16), data: Buffer.from(data || '', 'hex') });
}).on('close', () => process.exit(0));

const upload = (index, subIndex, dataType) => device.sdo.upload({ deviceId: node, index, subIndex, dataType, timeout: 2000 });
const download = (index, subIndex, data) => device.sdo.download({ deviceId: node, index, subIndex, data, timeout: 2000 });
const refused = (transfer) => transfer.then(() => 'taken', (error) => Number(error.code));

async function main() {
    device.eds.addSdoClientParameter(node, 0x600 + node, 0x580 + node);
    device.eds.addHeartbeatConsumer(node, 30000);
    for (const base of [0x180, 0x280]) {
        const index = 0x2000 + base;
        const names = base === 0x180 ? [1, 2, 3, 4] : [1, 2];
        const types = base === 0x180 ? Array(4).fill(DataType.INTEGER16) : [DataType.UNSIGNED32, DataType.UNSIGNED8];
        const entry = device.eds.addEntry(index, { parameterName: 'stream', objectType: 9 });
        for (const sub of names)
            device.eds.addSubEntry(index, sub, { parameterName: `part ${sub}`, dataType: types[sub - 1], pdoMapping: true });
        device.eds.addReceivePdo({ cobId: base + node, dataObjects: names.map((sub) => entry.at(sub)) });
        seen.pdos[base] = [];
    }
    device.pdo.addListener('pdo', ({ cobId, dataObjects }) => seen.pdos[cobId - node].push(dataObjects.map((each) => each.value)));
    device.nmt.addListener('heartbeat', ({ state }) => seen.beats.push(state));
    device.start();

    for (const [index, subIndex, name] of objects)
        seen.objects[name] = (await upload(index, subIndex)).toString('hex');
    seen.refusals = [
        await refused(upload(0x5000, 0)),
        await refused(upload(0x1018, 9)),
        await refused(download(0x1018, 1, Buffer.alloc(4))),
        await refused(download(0x2100, 1, Buffer.from([9]))),
        await refused(download(0x2100, 1, Buffer.alloc(2))),
    ];
    await download(0x2100, 1, Buffer.from([1]));
    seen.range = (await upload(0x2100, 1)).toString('hex');

    await download(0x1017, 0, Buffer.from([100, 0]));

    device.nmt.startNode(); // the master itself, without which it takes no samples
    device.nmt.startNode(node);
    await download(0x1005, 0, Buffer.from([0x80, 0, 0, 0x40]));
    await pause(0.5);
    await download(0x1005, 0, Buffer.from([0x80, 0, 0, 0]));
    device.nmt.stopNode(node);
    await pause(0.3);
    seen.stopped = await refused(upload(0x1018, 1));
    device.nmt.resetNode(node);
    await pause(0.1);
    seen.reset = (await upload(0x2100, 1)).toString('hex');
}

main().catch((error) => { seen.error = String(error); }).finally(() => {
    console.log(`=${JSON.stringify(seen)}`);
});
