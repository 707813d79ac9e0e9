// A peer in C#, on the code of the official lcm-gen and the transport of examples/modules/csharp/Lcm.cs; what it does
// stands in peer.c.
//
// Types are named `vec.geom.point_t`, their channels `vec_geom_point_t`. One more role, `types TYPE...`: makes one of
// each, encodes and decodes it.
using System;
using System.IO;
using System.Linq;
using System.Reflection;
using System.Text;
using System.Threading;
using LCM.LCM;

static class Peer
{
    const uint Sync = 0xeda1da01;

    static readonly Stream stdin = Console.OpenStandardInput(), stdout = Console.OpenStandardOutput();

    static int Main(string[] args)
    {
        string[] rest = args.Skip(1).ToArray();
        switch (args.FirstOrDefault())
        {
            case "log": CopyLog(rest[0], rest[1]); return 0;
            case "types": Array.ForEach(rest, Try); return 0;
            case "bus": Serve(rest); return 0;
            default: Console.Error.WriteLine("usage: peer bus | peer types | peer log IN OUT"); return 1;
        }
    }

    static void Serve(string[] types)
    {
        var lcm = new LCM.LCM.LCM();
        lcm.Subscribe("TO_.*", Tell);
        foreach (string name in types)
        {
            Type type = Find(name);
            lcm.Subscribe(name.Replace('.', '_'), (channel, data) =>
            {
                byte[] again = Again(type, data);
                Tell(channel, again);
                lcm.Publish("FROM_TYPED", again);
            });
        }
        stdout.Write(Encoding.ASCII.GetBytes("ready\n"), 0, 6);
        stdout.Flush();
        new Thread(() =>
        {
            while (true)
                lcm.Handle();
        }) { IsBackground = true }.Start();
        for (byte[] head; (head = Read(stdin, 8)) != null;)
        {
            string channel = Encoding.UTF8.GetString(Read(stdin, (int) Number(head, 0)));
            lcm.Publish(channel, Read(stdin, (int) Number(head, 4)));
        }
    }

    static void Tell(string channel, byte[] payload)
    {
        byte[] name = Encoding.UTF8.GetBytes(channel);
        byte[] bytes = Big((uint) name.Length).Concat(Big((uint) payload.Length)).Concat(name).ToArray();
        stdout.Write(bytes, 0, bytes.Length);
        stdout.Write(payload, 0, payload.Length);
        stdout.Flush();
    }

    // --- types ---

    static Type Find(string name)
    {
        Type type = Type.GetType(name) ?? Type.GetType("LCMTypes." + name);
        if (type == null)
            throw new ArgumentException("no type " + name);
        return type;
    }

    static void Try(string name)
    {
        Type type = Find(name);
        Again(type, Bytes((LCMEncodable) Filled(type)));
    }

    // Decodes and encodes.
    static byte[] Again(Type type, byte[] data)
    {
        return Bytes((LCMEncodable) Activator.CreateInstance(type, data));
    }

    static byte[] Bytes(LCMEncodable message)
    {
        var outs = new LCMDataOutputStream();
        message.Encode(outs);
        return outs.ToArray();
    }

    // A new one; what its constructor leaves null is given the least value.
    static object Filled(Type type)
    {
        if (type == typeof(string))
            return "";
        if (type.IsArray)
            return Array.CreateInstance(type.GetElementType(), new int[type.GetArrayRank()]);
        object made = Activator.CreateInstance(type);
        foreach (FieldInfo field in type.GetFields(BindingFlags.Public | BindingFlags.Instance))
        {
            object value = field.GetValue(made) ?? Filled(field.FieldType);
            Type element = field.FieldType.GetElementType();
            if (field.FieldType.IsArray && !element.IsValueType && field.FieldType.GetArrayRank() == 1)
                for (int n = 0; n < ((Array) value).Length; ++n)
                    ((Array) value).SetValue(Filled(element), n);
            field.SetValue(made, value);
        }
        return made;
    }

    // --- event logs ---

    static void CopyLog(string from, string to)
    {
        using (Stream source = new BufferedStream(File.OpenRead(from)), target = File.Create(to))
        {
            ulong events = 0;
            while (Synchronize(source))
            {
                byte[] head = Read(source, 24);
                byte[] rest = head == null ? null : Read(source, (int) (Number(head, 16) + Number(head, 20)));
                if (rest == null)
                    return; // the last one is cut short
                byte[] bytes = Big(Sync).Concat(Big((uint) (events >> 32))).Concat(Big((uint) events++))
                    .Concat(head.Skip(8)).Concat(rest).ToArray();
                target.Write(bytes, 0, bytes.Length);
            }
        }
    }

    // Reads to behind the next sync word; false at the end.
    static bool Synchronize(Stream source)
    {
        uint last = 0;
        for (int next; last != Sync; last = last << 8 | (uint) next)
            if ((next = source.ReadByte()) < 0)
                return false;
        return true;
    }

    // --- bytes ---

    // The next `length` bytes; null if the stream ends before.
    static byte[] Read(Stream source, int length)
    {
        var bytes = new byte[length];
        for (int at = 0, count; at < length; at += count)
            if ((count = source.Read(bytes, at, length - at)) == 0)
                return null;
        return bytes;
    }

    static byte[] Big(uint value)
    {
        return new[] { (byte) (value >> 24), (byte) (value >> 16), (byte) (value >> 8), (byte) value };
    }

    static uint Number(byte[] bytes, int at)
    {
        return (uint) (bytes[at] << 24 | bytes[at + 1] << 16 | bytes[at + 2] << 8 | bytes[at + 3]);
    }
}
